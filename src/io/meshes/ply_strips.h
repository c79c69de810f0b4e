// SPDX-License-Identifier: Apache-2.0
/* ply_strips: converts PLY files whose faces are triangle strips, as scanners write them, to PLY files of
 * triangles. Neither plain_mesh, which reads the mesh, nor assimp, which reads the attributes of vertices,
 * supports strips. Runs in the process that reads.
 */
#ifndef HEXAD_IO_MESHES_PLY_STRIPS_H
#define HEXAD_IO_MESHES_PLY_STRIPS_H

#include <stddef.h>

typedef enum ply_strips { PLY_STRIPS_READ, PLY_STRIPS_NO_MEMORY, PLY_STRIPS_DAMAGED } ply_strips;

/* *data is allocated with malloc, and (*data)[*size] is 0. If the last element of the file is a list of strips (32-bit indices; -1
 * begins a new strip), *data is freed and replaced by a file of triangles, also from malloc, and *size is
 * set. Any other file is not changed. PLY_STRIPS_READ: success, changed or not. PLY_STRIPS_DAMAGED: the
 * strips end early, or are not numbers. On failure *data is not changed. */
ply_strips ply_strips_expand(char **data, size_t *size);

#endif
