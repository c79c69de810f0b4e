// SPDX-License-Identifier: Apache-2.0
/* mesh_faces: projects points that were found on the level set of a closed mesh onto its triangles.
 *
 * A point is projected to the first of these that exists:
 * 1. If the mesh hides parts: the closest place, within 2 voxels, of the triangles that face the way of its
 *    normal (by less than 90 degrees) and lie on the outside of all solids.
 * 2. The closest place, within 2 voxels, of the triangles that face the way of its normal.
 * 3. The closest place of all triangles, at any distance and whichever way they face.
 * It is therefore not moved to the other side of a thin wall, nor to a part of the mesh that another solid
 * hides, if there is another place. World units. Projection: any thread. The result does not depend on the
 * number of threads of the pool, which may be NULL and is used by mesh_faces_new only.
 */
#ifndef HEXAD_SURFACE_LEVELSET_MESH_FACES_H
#define HEXAD_SURFACE_LEVELSET_MESH_FACES_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"
#include "surface/triangles/mesh_place.h"

typedef struct mesh_faces mesh_faces;

/* Takes ownership of *m, as levelset_make left it, and zeroes it, also on failure. `hides`: a part of the
 * mesh may lie inside solids; false saves the test whether triangles lie on the outside. NULL:
 * limit_memory. */
mesh_faces *mesh_faces_new(mesh *m, const double index_to_world[16], bool hides, threads *pool, error *e);
void mesh_faces_free(mesh_faces *f); /* accepts NULL */
size_t mesh_faces_bytes(const mesh_faces *f);

/* The projection of x; it always exists. `normal`: of any length > 0, pointing out of the solids. */
vec3 mesh_faces_project(const mesh_faces *f, vec3 x, vec3 normal);

/* The value `hides` of mesh_faces_new. */
bool mesh_faces_has_hidden(const mesh_faces *f);

/* The triangles, in voxels and sorted by groups; and the conversion of a place to world units. */
const mesh *mesh_faces_mesh(const mesh_faces *f);
vec3 mesh_faces_to_world(const mesh_faces *f, vec3 x_vox);
/* The length of a voxel, world units. */
double mesh_faces_unit(const mesh_faces *f);

/* The place of a point x of the surface, or of a surface at a distance from it, on the triangles: nearest to x, of
 * those that face the way of the normal, if there are such within 2 voxels. `normal`: of any length > 0. */
mesh_place mesh_faces_place(const mesh_faces *f, vec3 x, vec3 normal);

/* The closest place of all triangles, hidden ones included. */
vec3 mesh_faces_nearest(const mesh_faces *f, vec3 x);

#endif
