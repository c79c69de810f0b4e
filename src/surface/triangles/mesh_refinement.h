// SPDX-License-Identifier: Apache-2.0
/* mesh_refinement: halves long edges of triangles where the surface bends. If called until nothing changes,
 * normals that are interpolated between vertices turn only within about the distance `longest` from the edges
 * of large triangles. The surface itself does not change. Pure function except for allocation.
 */
#ifndef HEXAD_SURFACE_TRIANGLES_MESH_REFINEMENT_H
#define HEXAD_SURFACE_TRIANGLES_MESH_REFINEMENT_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"

/* One round: halves each edge longer than `longest` once, if a vertex normal (unit) of an adjacent triangle
 * differs from the normal of the triangle. Several vertices may have the same position, one for each patch:
 * an edge is halved in all patches or in none. Group k has the triangles first[k] .. first[k + 1] - 1, k <
 * count, before and after.
 *
 * *whole: per triangle, the index of the triangle before all rounds that contains it; NULL: its own index. It is
 * replaced if the mesh changes, and freed by the caller.
 *
 * *changed: an edge was halved. If the result would have more than `most` triangles, the mesh stays as it is,
 * *changed is false and the function returns true. The pool may be NULL; the result does not depend on it.
 * Errors: limit_memory, cancelled; the mesh is unchanged then, and *changed undefined.
 */
bool mesh_refine(mesh *m, const vec3 *normal, double longest, size_t most, size_t *first, size_t count,
                 uint32_t **whole, bool *changed, threads *pool, error *e);

#endif
