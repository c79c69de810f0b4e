/* label_graph: which vertices of a mesh between labels are neighbours, and which edges are lines: those at which surfaces meet
 * or end. Ownership: label_graph_free. Threads: none of its own; reading is safe in any number. */
#ifndef HEXAD_LABELS_LABEL_GRAPH_H
#define HEXAD_LABELS_LABEL_GRAPH_H

#include "base/error.h"
#include "triangles/mesh.h"

typedef struct label_graph {
    size_t *
        first; /* neighbours of vertex v: neighbour[first[v]] .. neighbour[first[v + 1]], those along lines first */
    uint32_t *neighbour;
    uint32_t *along; /* of each vertex: how many these are; 0: it is on no line */
    uint32_t *kind;  /* of each vertex on no line: that of its triangles */
} label_graph;

/* `kind` as in label_mesh: edges between triangles that differ in it are lines, too. A zeroed graph after failure.
 * Errors: limit_memory. */
bool label_graph_make(const mesh *m, const uint32_t *kind, label_graph *out, error *e);

/* For each vertex twice the sum of the area vectors of its triangles. */
void label_graph_normals(const mesh *m, vec3 *out);

void label_graph_free(label_graph *g); /* a zeroed one will do */

#endif
