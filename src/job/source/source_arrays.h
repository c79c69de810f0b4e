// SPDX-License-Identifier: Apache-2.0
/* source_arrays: inputs of a job that are arrays in memory. A path of the spec that is the name of an array means
 * that array. */
#ifndef HEXAD_JOB_SOURCE_SOURCE_ARRAYS_H
#define HEXAD_JOB_SOURCE_SOURCE_ARRAYS_H

#include <stddef.h>

#include "io/meshes/mesh_array.h"
#include "io/volumes/array_slices.h"

typedef enum source_array_kind {
    SOURCE_ARRAY_MESH,
    SOURCE_ARRAY_GRID,
    SOURCE_ARRAY_POINTS
} source_array_kind;

typedef struct source_array {
    char *name;
    source_array_kind kind; /* one of the next three is used */
    mesh_array mesh;
    array_grid grid;
    array_view points; /* (N, 3) */
} source_array;

typedef struct source_arrays {
    size_t count;
    source_array *item;
} source_arrays;

/* The array with this name; NULL: there is none, or `all` or `name` is NULL. */
const source_array *source_arrays_find(const source_arrays *all, const char *name);

/* Sets spec_invalid if the array is not of this kind. Returns whether it is. */
bool source_array_check(const source_array *a, source_array_kind kind, error *e);

#endif
