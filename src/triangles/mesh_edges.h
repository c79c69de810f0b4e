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
    size_t open, odd,
        branching;  /* edges of one triangle, of three or a larger odd number, of more than two */
    size_t against; /* edges of two triangles that go along them the same way */
} mesh_edges;

/* *out is what was there before, freed, or zeroed; free it after failure, too. Errors: limit_memory, cancelled. */
bool mesh_edges_list(const mesh *m, threads *pool, mesh_edges *out, error *e);
void mesh_edges_free(mesh_edges *edges);

/* How many sides the edge has that begins with the k-th, of lower vertex v. */
size_t mesh_edges_width(const mesh_edges *edges, size_t v, size_t k);

/* The edges of one triangle only. Free *out. Errors: limit_memory. */
bool mesh_edges_open(const mesh_edges *edges, seam_edge **out, size_t *count, error *e);

/* Closes open edges that meet others but for `tolerance`: vertices are joined, triangles split (see seams.h). `known` are the
 * edges of the mesh, or NULL. Returns those that it has then: `known`, or *own, which are listed where need be and the caller's
 * to free, also after failure, which gives NULL. Adds notes. Errors: limit_memory, cancelled. */
const mesh_edges *mesh_edges_close_seams(mesh *m, const mesh_edges *known, double tolerance, threads *pool,
                                         mesh_edges *own, mesh_notes *notes, error *e);

#endif
