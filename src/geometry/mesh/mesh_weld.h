// SPDX-License-Identifier: Apache-2.0
/* mesh_weld: makes one vertex of equal ones, and one triangle of duplicates.
 *
 * The result does not depend on the number of threads of the pool, which may be NULL. No shared state.
 */
#ifndef HEXAD_GEOMETRY_MESH_MESH_WELD_H
#define HEXAD_GEOMETRY_MESH_MESH_WELD_H

#include "geometry/mesh/mesh.h"

/* Treatment of duplicate triangles that occur equally often in both orientations. */
typedef enum mesh_cancelled {
    /* All are dropped where they are a contact (contacts.h), since they bound nothing. One is kept elsewhere. */
    MESH_DROP_CANCELLED,
    /* One is kept. */
    MESH_KEEP_CANCELLED,
    /* MESH_DROP_CANCELLED in connected components where an even number of triangles meets at every edge: there they
     * may be a contact of two solids. MESH_KEEP_CANCELLED in others: the orientation of an open surface is arbitrary. */
    MESH_DROP_IF_CLOSED
} mesh_cancelled;

/* Joins vertices with equal coordinates. Drops vertices without a triangle, triangles with two equal corners,
 * and duplicates of triangles; `cancelled` applies to those of opposite orientation. The order is kept. Sets
 * m->welded. Error: limit_memory. */
bool mesh_weld(mesh *m, mesh_cancelled cancelled, mesh_notes *notes, error *e);

/* mesh_weld if that only joins vertices and drops vertices without a triangle, so that a later mesh_weld of
 * the mesh or of a copy has nothing to do. Otherwise the mesh is not welded. Errors: limit_memory,
 * cancelled. */
bool mesh_weld_clean(mesh *m, threads *pool, error *e);

/* Joins vertices with equal coordinates; drops neither triangles nor vertices. Errors: limit_memory,
 * cancelled. */
bool mesh_weld_vertices(mesh *m, threads *pool, error *e);

#endif
