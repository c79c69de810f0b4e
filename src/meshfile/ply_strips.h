/* ply_strips: PLY files whose faces are triangle strips, as scanners write them, turned into files of triangles, which the
 * library reads. Runs in the process that reads. */
#ifndef HEXAD_MESHFILE_PLY_STRIPS_H
#define HEXAD_MESHFILE_PLY_STRIPS_H

#include <stddef.h>

typedef enum ply_strips { PLY_STRIPS_READ, PLY_STRIPS_NO_MEMORY, PLY_STRIPS_DAMAGED } ply_strips;

/* *data is malloc's, and is exchanged where the last element of the file is one of strips: a list of 32-bit indices, -1
 * beginning a new strip. Whatever else the file is, it stays as it is. PLY_STRIPS_DAMAGED: the strips end early, or are not numbers. */
ply_strips ply_strips_expand(char **data, size_t *size);

#endif
