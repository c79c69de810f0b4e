// SPDX-License-Identifier: Apache-2.0
/* library_mesh: FBX, COLLADA and glTF with Draco, read by the library assimp. With library_scene and library_textures it
 * is the only user of that library. Runs in the process that reads. Threads: none.
 */
#ifndef HEXAD_IO_MESHES_LIBRARY_MESH_H
#define HEXAD_IO_MESHES_LIBRARY_MESH_H

#include "io/meshes/plain_mesh.h"

/* Reads a file of a format that the registry leaves to the library, or a glTF file that needs it. data[size] is 0.
 * `memory`: the limit of the process, bytes. *out as for plain_mesh_read; textures are those of COLLADA. False: *out is
 * refused. */
bool library_mesh_read(file_format format, const char *data, size_t size, size_t memory, plain_mesh *out);

#endif
