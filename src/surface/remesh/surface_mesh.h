// SPDX-License-Identifier: Apache-2.0
/* surface_mesh: triangles between points on a triangle mesh: the dual of the cells of the points
 * (geodesic_cells).
 *
 * Edges are flipped until the sum of the two angles opposite to each edge is at most 180 degrees.
 *
 * If all cells are discs, the triangles have the topology of the mesh, independent of the distance of
 * opposite walls and of the angle of its edges. Other cells are repaired if points are available, so that no
 * edge has four triangles: cells that meet in several places, as on a fin; a cell that another one surrounds,
 * as at a tip; and a cell around a neck. At a boundary of the mesh, the triangles end at the edges between
 * the points along it. World space. Single-threaded.
 */
#ifndef HEXAD_SURFACE_REMESH_SURFACE_MESH_H
#define HEXAD_SURFACE_REMESH_SURFACE_MESH_H

#include "base/core/error.h"
#include "geometry/mesh/mesh.h"
#include "surface/remesh/fine_mesh.h"

typedef struct surface_mesh_input {
    const mesh *m;
    size_t count;
    const vec3 *position; /* on the mesh */
    const double *spacing;
    const uint32_t *name; /* the vertex of the result for each point; several points may have the same */
    size_t names;
    /* segments along curves, each between two of the points; their edges are kept */
    const uint32_t (*side)[2];
    size_t side_count;
    const fine_mesh_part *part; /* of the mesh, with all points on it; NULL: the whole mesh */
} surface_mesh_input;

/* Triangles with the orientation of the mesh; the caller frees them. Error: limit_memory. Deterministic. */
bool surface_mesh_make(const surface_mesh_input *in, uint32_t (**triangle)[3], size_t *count, error *e);

#endif
