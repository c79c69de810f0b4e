// SPDX-License-Identifier: Apache-2.0
/* library_scene: what the library assimp does not apply of a file.
 *
 * Used by library_mesh, in the process that reads. Threads: none.
 */
#ifndef HEXAD_IO_MESHES_LIBRARY_SCENE_H
#define HEXAD_IO_MESHES_LIBRARY_SCENE_H

#include <assimp/scene.h>

#include "io/meshes/plain_mesh.h"

/* Begins to keep the warnings of the library about the next file. With `textures`: those about
 * materials and images; otherwise the others. */
void library_scene_listen(bool textures);

/* Adds warnings about what is not applied of a file that the registry leaves to the library: units, axes, hidden nodes,
 * meshes without a node, and the warnings of the library. */
void library_scene_warn(const struct aiScene *scene, file_format format, plain_mesh *m);

#endif
