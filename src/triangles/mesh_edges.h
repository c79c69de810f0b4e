/* mesh_edges: which triangles meet at each edge of a mesh.
 *
 * Ownership: mesh_edges_free. Threads: those of a pool, or NULL, whose number does not show; no shared state.
 */
#ifndef HEXAD_TRIANGLES_MESH_EDGES_H
#define HEXAD_TRIANGLES_MESH_EDGES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "triangles/mesh.h"
#include "triangles/seams.h"

/* A triangle's way along an edge. */
typedef struct mesh_side {
    uint32_t other; /* the edge's higher vertex; the lower one tells where the side stands */
    uint32_t triangle : 31;
    uint32_t upwards : 1; /* from the lower vertex to the higher one */
} mesh_side;

/* Sides by their lower vertex: sides[first[v]] .. sides[first[v + 1]], by the other vertex, then by triangle. */
typedef struct mesh_edges {
    size_t vertex_count;
    mesh_side *sides;
    size_t *first;
} mesh_edges;

/* *out is what was there before, freed, or zeroed; free it after failure, too. Errors: limit_memory, cancelled. */
bool mesh_edges_list(const mesh *m, threads *pool, mesh_edges *out, error *e);
void mesh_edges_free(mesh_edges *edges);

/* How many sides the edge has that begins with the k-th, of lower vertex v. */
size_t mesh_edges_width(const mesh_edges *edges, size_t v, size_t k);

/* The edges of one triangle only. Free *out. Errors: limit_memory. */
bool mesh_edges_open(const mesh_edges *edges, seam_edge **out, size_t *count, error *e);

/* Closes open edges that meet others but for `tolerance`: vertices are joined, triangles split (see seams.h). The
 * edges are listed anew where that changed the mesh. Adds notes. Errors: limit_memory, cancelled. */
bool mesh_edges_close_seams(mesh *m, double tolerance, threads *pool, mesh_edges *edges, mesh_notes *notes,
                            error *e);

#endif
