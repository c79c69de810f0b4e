// SPDX-License-Identifier: Apache-2.0
/* collada_textures: what the library assimp does not read of the images of a COLLADA file: how they continue beyond
 * their sides (wrap_s, wrap_t), and which set of coordinates they use (bind_vertex_input).
 *
 * Runs in the process that reads. Threads: none.
 */
#ifndef HEXAD_IO_MESHES_COLLADA_TEXTURES_H
#define HEXAD_IO_MESHES_COLLADA_TEXTURES_H

#include "io/meshes/plain_mesh.h"

/* Sets the wrap modes of each material of m->textures, by its name, and its set of coordinates, set[material]. Returns
 * false if *m is refused. */
bool collada_textures_read(const char *data, size_t size, plain_mesh *m, uint32_t *set);

#endif
