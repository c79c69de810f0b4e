// SPDX-License-Identifier: Apache-2.0
/* flat_triangles: removes triangles without area that have three distinct corners. The corners of such a
 * triangle are collinear within the rounding error of their coordinates, so that its normal is arbitrary. If
 * two corners coincide to within rounding, their edge is collapsed. Otherwise one corner lies on the longest
 * side: the triangle is removed, and the other triangles at that side are split at the corner. Both keep
 * closed surfaces closed, and move the surface by no more than the rounding. The result does not depend on
 * the number of threads of the pool, which may be NULL. No shared state.
 */
#ifndef HEXAD_GEOMETRY_MESH_FLAT_TRIANGLES_H
#define HEXAD_GEOMETRY_MESH_FLAT_TRIANGLES_H

#include <stdbool.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"
#include "geometry/mesh/rounding.h"

/* If there are flat triangles: joins equal vertices, removes the flat triangles and adds a note with their
 * number. Otherwise the mesh is unchanged. Triangles with two equal corners are not removed (mesh_weld does).
 * Errors: limit_memory, cancelled; the mesh is valid then, but may be changed. */
bool flat_triangles_remove(mesh *m, threads *pool, mesh_notes *notes, error *e);

/* As flat_triangles_remove, for triangles that are flat within the rounding error `r`. Adds no note. */
bool flat_triangles_remove_thin(mesh *m, const rounding *r, error *e);

#endif
