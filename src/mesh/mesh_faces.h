/* mesh_faces: the triangles of a closed mesh, to put the points on that were found on its level set.
 *
 * A point goes to the nearest place of the triangles that look its way and lie on the outside of all solids: not to the
 * other side of a thin wall, nor to what the union hides. World units. Threads: landing is safe in any number; of a pool, which may
 * be NULL and does not show, while it is made.
 */
#ifndef HEXAD_MESH_MESH_FACES_H
#define HEXAD_MESH_MESH_FACES_H

#include "base/error.h"
#include "base/threads.h"
#include "triangles/mesh.h"

typedef struct mesh_faces mesh_faces;

/* Takes over *m, as levelset_make left it, and zeroes it. `hides`: a part of it lies in solids. Error: limit_memory. */
mesh_faces *mesh_faces_new(mesh *m, const double index_to_world[16], bool hides, threads *pool, error *e);
void mesh_faces_free(mesh_faces *f); /* NULL will do */
size_t mesh_faces_bytes(const mesh_faces *f);

/* The place for a point at x whose normal, of any length, points out of the solids. */
vec3 mesh_faces_land(const mesh_faces *f, vec3 x, vec3 normal);

/* Whether a part of the mesh may lie in solids. */
bool mesh_faces_hide(const mesh_faces *f);

/* The triangles in voxels, group after group, and a place of them in world units. */
const mesh *mesh_faces_mesh(const mesh_faces *f);
vec3 mesh_faces_to_world(const mesh_faces *f, vec3 x_vox);

/* The nearest place of all triangles, hidden or not. */
vec3 mesh_faces_nearest(const mesh_faces *f, vec3 x);

#endif
