/* geodesic_cells: whose point's cell a vertex of a mesh is in: that of the nearest along the surface.
 *
 * Distances go from triangle to triangle, each laid flat beside the one before (R. Kimmel and J. Sethian 1998, "Computing
 * geodesic paths on manifolds"), so opposite walls are distinguished at any distance. World space. Threads: none.
 */
#ifndef HEXAD_REMESH_GEODESIC_CELLS_H
#define HEXAD_REMESH_GEODESIC_CELLS_H

#include "remesh/fine_mesh.h"

#define GEODESIC_CELLS_NONE UINT32_MAX

/* For each vertex the name of the point whose cell it is in; GEODESIC_CELLS_NONE in a part that has none. Points lie on the
 * mesh; several may have one name. To be freed. Error: limit_memory. Deterministic. */
bool geodesic_cells_grow(const fine_mesh *f, size_t count, const vec3 *position, const uint32_t *name,
                         uint32_t **out, error *e);

#endif
