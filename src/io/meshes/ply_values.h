// SPDX-License-Identifier: Apache-2.0
/* ply_values: reads the colours of the vertices of a PLY file, and those of their properties that assimp does not return. Only used if
 * attributes are requested (mesh_file_read_values), since assimp reads the file then. Runs in the process
 * that reads.
 */
#ifndef HEXAD_IO_MESHES_PLY_VALUES_H
#define HEXAD_IO_MESHES_PLY_VALUES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "io/meshes/mesh_reader.h"

typedef struct ply_values {
    uint32_t count; /* properties, at most MESH_VALUES_MOST; further ones are skipped */
    size_t vertices;
    char name[MESH_VALUES_MOST][MESH_VALUES_NAME_SIZE];
    float *value[MESH_VALUES_MOST]; /* per property: one number for each vertex */
    float (*color)[4];              /* of each vertex, from 0 to 1; NULL: none */
    const char *refused;            /* the type of colours whose range is not known; or NULL */
} ply_values;

/* Reads a file whose first element is `vertex`, with single numbers as properties. data[size] is 0. *out is zeroed before the
 * call. For any other file out->count is 0. Colours: whole numbers of 8 bits are over 255, those of 16 bits without a sign over
 * 65 535, others over 255, unless one is below 0 or above 255: these are refused. Floats are over 255 only if one of them is
 * above 1. False: no memory. */
bool ply_values_read(const char *data, size_t size, ply_values *out);

#endif
