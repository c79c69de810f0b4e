/* ply_strips: PLY files whose faces are triangle strips, as scanners write them, turned into files of triangles, which the
 * library reads. Runs in the process that reads. */
#ifndef HEXAD_MESH_PLY_STRIPS_H
#define HEXAD_MESH_PLY_STRIPS_H

#include <stdbool.h>
#include <stddef.h>

/* *data is malloc's, and is exchanged where the last element of the file is one of strips: a list of 32-bit indices, -1
 * beginning a new strip. Whatever else the file is, it stays as it is. False: no memory. */
bool ply_strips_expand(char **data, size_t *size);

#endif
