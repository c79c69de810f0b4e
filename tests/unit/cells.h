// SPDX-License-Identifier: Apache-2.0
/* cells: checks that hold for the cells of every field. */
#ifndef HEXAD_TESTS_CELLS_H
#define HEXAD_TESTS_CELLS_H

#include <math.h>

#include "close.h"
#include "surface/field/field.h"

/* Checks that the centre of a cell is the centre of its corners, and that its radius reaches the farthest
 * corner. */
static inline void check_middle(const field *f, size_t k, const field_cell *cell)
{
    double radius, farthest = 0;
    const vec3 middle = f->ops->cell_middle(f, k, &radius);
    vec3 sum = {0, 0, 0};
    for (int c = 0; c < 8; c++) {
        sum = vec3_add(sum, cell->corner[c]);
        farthest = fmax(farthest, vec3_norm(vec3_sub(cell->corner[c], middle)));
    }
    assert_close(vec3_norm(vec3_sub(vec3_scale(sum, 0.125), middle)), 0, 1e-9 * radius);
    assert_close(farthest, radius, 1e-9 * radius);
}

#endif
