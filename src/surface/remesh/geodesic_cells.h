// SPDX-License-Identifier: Apache-2.0
/* geodesic_cells: assigns each vertex of a mesh to the point that is nearest along the surface.
 *
 * Distances propagate from triangle to triangle, each unfolded into the plane of the previous one (R. Kimmel
 * and J. Sethian 1998, "Computing geodesic paths on manifolds"). Opposite walls are therefore distinguished
 * at any distance. World space. Single-threaded.
 */
#ifndef HEXAD_SURFACE_REMESH_GEODESIC_CELLS_H
#define HEXAD_SURFACE_REMESH_GEODESIC_CELLS_H

#include "surface/remesh/fine_mesh.h"

#define GEODESIC_CELLS_NONE UINT32_MAX

/* Returns for each vertex the name of its point; GEODESIC_CELLS_NONE in a connected part without points.
 * Points lie on the mesh; several points may have the same name. The caller frees the result. Error:
 * limit_memory. Deterministic. */
bool geodesic_cells_grow(const fine_mesh *f, size_t count, const vec3 *position, const uint32_t *name,
                         uint32_t **out, error *e);

#endif
