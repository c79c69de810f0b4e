/* ply_values: properties of a PLY file's vertices that assimp does not read. Runs in the process that reads.
 */
#ifndef HEXAD_MESHFILE_PLY_VALUES_H
#define HEXAD_MESHFILE_PLY_VALUES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "meshfile/mesh_reader.h"

typedef struct ply_values {
    uint32_t count;
    size_t vertices;
    char name[MESH_VALUES_MOST][MESH_VALUES_NAME_SIZE];
    float *value[MESH_VALUES_MOST]; /* one a vertex */
} ply_values;

/* Reads a file whose first element is `vertex`, with single numbers as properties; other files have no values. False:
 * no memory. */
bool ply_values_read(const char *data, size_t size, ply_values *out);

#endif
