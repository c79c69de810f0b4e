/* triangle_groups: the triangles of a mesh, those with their middles in one voxel together, and how far the voxels of a block are
 * from them.
 *
 * Units: voxels. Ownership: triangle_groups_free; the mesh outlives them. Threads: those of a pool, or NULL, whose number does not
 * show, while they are made; approaching is safe in any number.
 */
#ifndef HEXAD_MESH_TRIANGLE_GROUPS_H
#define HEXAD_MESH_TRIANGLE_GROUPS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/bbox.h"
#include "triangles/mesh.h"

#define TRIANGLE_GROUPS_SIDE 8 /* of a block */
#define TRIANGLE_GROUPS_VOXELS 512

/* A disc around some triangles, thick enough to hold them. */
typedef struct triangle_disc {
    vec3 middle, normal; /* of length 1; 0: a ball */
    double radius, depth;
} triangle_disc;

/* Each is of one solid; in the order of solids. */
typedef struct triangle_groups {
    const mesh *m;
    size_t count;
    uint32_t *first, *triangle; /* of group g: triangle[first[g]] .. triangle[first[g + 1]], in their order */
    bbox *box;
    triangle_disc *disc;
    vec3 *place; /* on one of the triangles */
} triangle_groups;

/* Coordinates of the mesh are not negative and less than 2^14. Triangles of solid s: first_of_solid[s] .. first_of_solid[s + 1], up to the
 * last of all. Errors: limit_memory, cancelled. */
bool triangle_groups_make(const mesh *m, const uint32_t *first_of_solid, threads *pool, triangle_groups *out,
                          error *e);
void triangle_groups_free(triangle_groups *groups); /* zeroed ones will do */
size_t triangle_groups_bytes(const triangle_groups *groups);

/* Whether a triangle of the group is as near to a place as that; squared. */
bool triangle_groups_come_near(const triangle_groups *groups, uint32_t group, vec3 place, double reach2);

/* How far each voxel of a block, whose lowest is `origin`, is from the nearest triangle of the groups that `near` lists, or `band`
 * if that is less. */
void triangle_groups_approach(const triangle_groups *groups, const uint32_t *near, size_t count,
                              const int32_t origin[3], double band, double nearest[TRIANGLE_GROUPS_VOXELS]);

#endif
