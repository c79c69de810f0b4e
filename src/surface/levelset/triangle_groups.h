// SPDX-License-Identifier: Apache-2.0
/* triangle_groups: groups of triangles whose centroids lie in the same voxel, and the distances of the voxels
 * of a block from them.
 *
 * Units: voxels. The mesh is not owned and outlives the groups. The result does not depend on the number of
 * threads of the pool, which may be NULL and is used by triangle_groups_make only. The other functions: any
 * thread.
 */
#ifndef HEXAD_SURFACE_LEVELSET_TRIANGLE_GROUPS_H
#define HEXAD_SURFACE_LEVELSET_TRIANGLE_GROUPS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/bbox.h"
#include "geometry/mesh/mesh.h"

#define TRIANGLE_GROUPS_SIDE 8     /* voxels along a side of a block */
#define TRIANGLE_GROUPS_VOXELS 512 /* voxels of a block */

/* A disc that contains triangles. */
typedef struct triangle_disc {
    vec3 middle, normal;  /* unit; zero: the disc is a ball */
    double radius, depth; /* depth: half of the thickness */
} triangle_disc;

/* The groups, sorted by solid. Each has triangles of one solid. */
typedef struct triangle_groups {
    const mesh *m;
    size_t count;
    /* group g has triangle[first[g]] .. triangle[first[g + 1] - 1], ascending */
    uint32_t *first, *triangle;
    bbox *box;           /* per group */
    triangle_disc *disc; /* per group */
    vec3 *place;         /* per group: a point on one of its triangles */
} triangle_groups;

/* Makes the groups. Coordinates of the mesh are at least 0 and less than 2^14. Solid s has the triangles
 * first_of_solid[s] .. first_of_solid[s + 1] - 1; the last entry is the number of triangles. Errors:
 * limit_memory, cancelled. */
bool triangle_groups_make(const mesh *m, const uint32_t *first_of_solid, threads *pool, triangle_groups *out,
                          error *e);
void triangle_groups_free(triangle_groups *groups); /* accepts a zeroed object */
size_t triangle_groups_bytes(const triangle_groups *groups);

/* Whether a triangle of the group is within a squared distance of a place. */
bool triangle_groups_is_within(const triangle_groups *groups, uint32_t group, vec3 place, double reach2);

/* Sets nearest[64 x + 8 y + z] to the distance of the voxel origin + (x, y, z) from the nearest triangle of
 * the `count` groups `near`, or to `band` if that is smaller. Earlier values are overwritten. `origin`: the
 * voxel of the block with the least coordinates. */
void triangle_groups_lower_distances(const triangle_groups *groups, const uint32_t *near, size_t count,
                                     const int32_t origin[3], double band,
                                     double nearest[TRIANGLE_GROUPS_VOXELS]);

#endif
