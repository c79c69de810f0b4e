// SPDX-License-Identifier: Apache-2.0
/* mesh_check: checks of meshes and points from outside, of files and of arrays. Messages do not name the
 * input. Pure functions. */
#ifndef HEXAD_IO_MESHES_MESH_CHECK_H
#define HEXAD_IO_MESHES_MESH_CHECK_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "geometry/mesh/mesh.h"

/* Largest accepted coordinate. Computations with squares and products of larger ones overflow. */
#define MESH_CHECK_LARGEST 1e30

/* Whether the coordinates are finite and not too large. */
static inline bool mesh_check_is_usable(vec3 v)
{
    return fabs(v.x) <= MESH_CHECK_LARGEST && fabs(v.y) <= MESH_CHECK_LARGEST &&
           fabs(v.z) <= MESH_CHECK_LARGEST;
}

/* `others`: points and lines, for the message. Errors: no_surface (there is no triangle), input_unsupported,
 * limit_memory. */
bool mesh_check_counts(uint64_t vertices, uint64_t triangles, uint64_t others, size_t limit, error *e);

/* Refuses triangles with a vertex that is not finite or exceeds the largest coordinate: input_damaged. Such
 * vertices without a triangle are replaced by a usable vertex; *unused: their number. */
bool mesh_check_vertices(mesh *m, size_t *unused, error *e);

/* Refuses points that are not finite or exceed the largest coordinate: input_damaged. */
bool mesh_check_points(const vec3 *point, size_t count, error *e);

/* Add the notes about such vertices, and about polygons that cross themselves, if there are any. */
void mesh_check_note_unused(mesh_notes *notes, size_t unused);
void mesh_check_note_crossed(mesh_notes *notes, uint64_t crossed);

#endif
