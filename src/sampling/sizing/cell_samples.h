// SPDX-License-Identifier: Apache-2.0
/* cell_samples: one place of the surface in each grid cell, with its normal. World units. */
#ifndef HEXAD_SAMPLING_SIZING_CELL_SAMPLES_H
#define HEXAD_SAMPLING_SIZING_CELL_SAMPLES_H

#include <stdbool.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/scan/surface.h"

typedef struct cell_samples {
    vec3 *
        /* Per cell: on the surface to a thousandth of the cell if found; otherwise the centre of the cell. */
        position;
    vec3 *normal;    /* unit vectors, if found */
    uint32_t *patch; /* patch of the place; 0 without patches */
    bool *found;     /* false: the surface is too far from the centre, or has no normal */
} cell_samples;

/* Samples all cells, until the pool is stopped. Free *out also after failure. Error: limit_memory. */
bool cell_samples_take(const surface *scan, threads *pool, cell_samples *out, error *e);
void cell_samples_free(cell_samples *s);

#endif
