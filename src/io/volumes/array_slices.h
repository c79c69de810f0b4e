// SPDX-License-Identifier: Apache-2.0
/* array_slices: an array in memory as a dense volume. The array is read when the slices are. */
#ifndef HEXAD_IO_VOLUMES_ARRAY_SLICES_H
#define HEXAD_IO_VOLUMES_ARRAY_SLICES_H

#include "base/core/array_view.h"
#include "io/volumes/slices.h"

/* Values (I, J, K), and the place of element (i, j, k): index_to_world (i, j, k, 1), row-major. */
typedef struct array_grid {
    array_view values;
    double index_to_world[16];
} array_grid;

/* The caller keeps *grid and its array until it closes the slices. Errors: input_damaged (an axis has fewer than two
 * samples, the matrix is not affine, is not finite or cannot be inverted); of the slices: cancelled. */
slices *array_slices_open(const array_grid *grid, error *e);

/* The checks of array_slices_open. */
bool array_grid_check(const array_grid *grid, error *e);

#endif
