// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/array_slices.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "geometry/space/affine.h"
#include "io/volumes/numbers.h"

typedef struct array_slices {
    slices base; /* first: the slices' functions get this pointer */
    const array_grid *grid;
} array_slices;

static bool read_slice(slices *base, int64_t k, double *values, error *e)
{
    array_slices *s = (array_slices *)base;
    const array_view *a = &s->grid->values;
    for (size_t j = 0; j < a->size[1]; j++) {
        if (array_view_stopped(a)) return error_set(e, ERROR_CANCELLED, "stopped");
        const char *p = (const char *)a->data + (ptrdiff_t)j * a->stride[1] + k * a->stride[2];
        for (size_t i = 0; i < a->size[0]; i++, p += a->stride[0]) {
            numbers_note_inexact((const unsigned char *)p, a->type, false, base->inexact);
            *values++ = number_value(p, a->type, false);
        }
    }
    return true;
}

static void end(slices *base)
{
    free(base);
}

static const slices_ops operations = {read_slice, end};

bool array_grid_check(const array_grid *grid, error *e)
{
    const double *m = grid->index_to_world;
    for (int k = 0; k < 3; k++)
        if (grid->values.size[k] < 2)
            return error_set(e, ERROR_INPUT_DAMAGED,
                             "values has %zu samples along axis %d: it must have at least 2 along each axis",
                             grid->values.size[k], k);
    for (int k = 0; k < 16; k++)
        if (!isfinite(m[k]))
            return error_set(e, ERROR_INPUT_DAMAGED, "affine[%d, %d] is not finite: correct it", k / 4,
                             k % 4);
    if (m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1)
        return error_set(e, ERROR_INPUT_DAMAGED, "the last row of affine must be 0, 0, 0, 1");
    double to_world[3][4], unused[3][4];
    for (int k = 0; k < 12; k++) to_world[k / 4][k % 4] = m[k];
    const double volume = affine_invert(to_world, unused);
    return (isfinite(volume) && volume != 0) ||
           error_set(e, ERROR_INPUT_DAMAGED, "affine cannot be inverted: its axes must span space");
}

slices *array_slices_open(const array_grid *grid, error *e)
{
    if (!array_grid_check(grid, e)) return NULL;
    array_slices *s = mem_alloc(sizeof *s);
    *s = (array_slices){.base = {.ops = &operations,
                                 .components = 1,
                                 .format = "array",
                                 .type = numbers_name(grid->values.type)},
                        .grid = grid};
    for (int k = 0; k < 3; k++) s->base.size[k] = (int64_t)grid->values.size[k];
    memcpy(s->base.index_to_world, grid->index_to_world, sizeof s->base.index_to_world);
    s->base.fine = numbers_need_doubles(grid->values.type);
    return &s->base;
}
