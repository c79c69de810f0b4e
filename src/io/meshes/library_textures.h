// SPDX-License-Identifier: Apache-2.0
/* library_textures: materials, images and texture coordinates of a COLLADA file that the library assimp has read.
 *
 * Used by mesh_reader, in the process that reads. Threads: none.
 */
#ifndef HEXAD_IO_MESHES_LIBRARY_TEXTURES_H
#define HEXAD_IO_MESHES_LIBRARY_TEXTURES_H

#include <assimp/scene.h>

#include "io/meshes/plain_mesh.h"

/* Adds the materials of the scene, which is that of the file `data`, to m->textures. Adds what each polygon has of
 * them, in the order in which mesh_reader writes the polygons. Returns false if *m is refused. */
bool library_textures_read(const struct aiScene *scene, const char *data, size_t size, plain_mesh *m);

#endif
