// SPDX-License-Identifier: Apache-2.0
/* label_graph: the neighbours of each vertex of a mesh between labels, and the line edges, at which
 * interfaces meet or end.
 *
 * Ownership: label_graph_free. Not synchronised; concurrent reads are permitted.
 */
#ifndef HEXAD_SURFACE_LABELS_LABEL_GRAPH_H
#define HEXAD_SURFACE_LABELS_LABEL_GRAPH_H

#include "base/core/error.h"
#include "geometry/mesh/mesh.h"

typedef struct label_graph {
    /* vertex v has the neighbours neighbour[first[v]] .. neighbour[first[v + 1] - 1]; neighbours along line
     * edges come first */
    size_t *first;
    uint32_t *neighbour;
    /* per vertex: the number of its neighbours along line edges; 0: the vertex is on no line */
    uint32_t *along;
    uint32_t *kind; /* per vertex that is on no line: the kind of its triangles */
} label_graph;

/* `kind`: as in label_mesh; edges between triangles of different kinds are line edges, too. After an
 * error *out is zeroed. Errors: limit_memory. */
bool label_graph_make(const mesh *m, const uint32_t *kind, label_graph *out, error *e);

/* Computes for each vertex twice the sum of the area vectors of its triangles. */
void label_graph_normals(const mesh *m, vec3 *out);

void label_graph_free(label_graph *g); /* accepts a zeroed object */

#endif
