// SPDX-License-Identifier: Apache-2.0
/* library_textures: materials and images of a COLLADA file that the library assimp has read, and the coordinates that its
 * images use.
 *
 * Used by library_mesh, in the process that reads. Threads: none.
 */
#ifndef HEXAD_IO_MESHES_LIBRARY_TEXTURES_H
#define HEXAD_IO_MESHES_LIBRARY_TEXTURES_H

#include <assimp/scene.h>

#include "io/meshes/plain_mesh.h"

/* Adds the materials of the scene, which is that of the file `data`, to m->textures. *set: for each material the set of
 * coordinates of its image; the caller frees it, also after false: *m is refused. */
bool library_textures_read(const struct aiScene *scene, const char *data, size_t size, plain_mesh *m,
                           uint32_t **set);

/* The coordinates of a set, or NULL. The library numbers the sets of a mesh from 0, also if the file does not: a single
 * one has any number. */
const struct aiVector3D *library_textures_coordinates(const struct aiMesh *mesh, uint32_t set);

#endif
