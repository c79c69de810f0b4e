// SPDX-License-Identifier: Apache-2.0
/* library_scene: which formats the library assimp may read, and what it does not apply of a file.
 *
 * Used by mesh_reader, in the process that reads. Threads: none.
 */
#ifndef HEXAD_IO_MESHES_LIBRARY_SCENE_H
#define HEXAD_IO_MESHES_LIBRARY_SCENE_H

#include <assimp/scene.h>

#include "io/meshes/plain_mesh.h"

/* Refuses a file by the ending of its name, if it is that of a format of the library that is not read, and
 * of no other. Returns false if *m is refused. */
bool library_scene_accepts(const char *ending, plain_mesh *m);

/* Begins to keep the warnings of the library about the next file. With `textures`: those about
 * materials and images; otherwise the others. */
void library_scene_listen(bool textures);

/* Refuses a scene that was read from a format that is not read; the library also recognises formats by their
 * contents. Otherwise adds warnings about what is not applied: units, axes, hidden nodes, meshes without a
 * node, and the warnings of the library. Returns false if *m is refused. */
bool library_scene_check(const struct aiScene *scene, plain_mesh *m);

#endif
