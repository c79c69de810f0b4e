// SPDX-License-Identifier: Apache-2.0
/* mesh_edges: the triangles at each edge of a mesh, as half-edges (sides) sorted by edge.
 *
 * Free with mesh_edges_free. The result does not depend on the number of threads of the pool, which may be
 * NULL. No shared state.
 */
#ifndef HEXAD_GEOMETRY_MESH_MESH_EDGES_H
#define HEXAD_GEOMETRY_MESH_MESH_EDGES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"
#include "geometry/mesh/seams.h"

/* A half-edge: an edge in a triangle. */
typedef struct mesh_side {
    uint32_t other; /* the higher vertex of the edge; the lower one determines the position in `sides` */
    uint32_t triangle : 31;
    /* the triangle has the edge in the direction from the lower to the higher vertex */
    uint32_t upwards : 1;
} mesh_side;

/* Lower vertex v has the sides sides[first[v]] .. sides[first[v + 1] - 1], sorted by the other vertex, then
 * by triangle. */
typedef struct mesh_edges {
    size_t vertex_count;
    mesh_side *sides;
    size_t *first;
    size_t open;      /* number of edges of one triangle */
    size_t odd;       /* edges of three or a larger odd number of triangles */
    size_t branching; /* edges of more than two triangles */
    size_t against;   /* edges of two triangles of inconsistent orientation */
} mesh_edges;

/* Lists the sides of all triangles. *out is zeroed, or an earlier result, which is freed. Free *out also
 * after failure. Errors: limit_memory, cancelled. */
bool mesh_edges_list(const mesh *m, threads *pool, mesh_edges *out, error *e);
void mesh_edges_free(mesh_edges *edges);

/* The number of sides of the edge whose first side is number k, with lower vertex v. */
size_t mesh_edges_width(const mesh_edges *edges, size_t v, size_t k);

/* Lists the edges of one triangle. Free *out. Error: limit_memory. */
bool mesh_edges_open(const mesh_edges *edges, seam_edge **out, size_t *count, error *e);

/* Closes open edges that meet others within `tolerance`: joins vertices and splits triangles (see seams.h).
 * `known`: the edges of the mesh, or NULL. Returns the edges afterwards: `known`, or *own, which the caller
 * frees, also after failure. NULL on error: limit_memory, cancelled. Adds notes. */
const mesh_edges *mesh_edges_close_seams(mesh *m, const mesh_edges *known, double tolerance, threads *pool,
                                         mesh_edges *own, mesh_notes *notes, error *e);

#endif
