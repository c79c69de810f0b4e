/* cell_samples: one place of the surface in each of its cells, with the normal there. World units. */
#ifndef HEXAD_SIZING_CELL_SAMPLES_H
#define HEXAD_SIZING_CELL_SAMPLES_H

#include <stdbool.h>

#include "base/error.h"
#include "base/threads.h"
#include "surface/surface.h"

typedef struct cell_samples {
    vec3 *
        position; /* of each cell; on the surface to a hundredth of the cell where found, else the cell's middle */
    vec3 *normal;    /* unit, where found */
    uint32_t *patch; /* that the place is of; 0 without patches */
    bool *found;     /* false where the surface is too far from the middle, or has no normal */
} cell_samples;

/* Looks at every cell, as long as the pool is not told to stop. Free *out after failure, too. Error: limit_memory. */
bool cell_samples_take(const surface *scan, threads *pool, cell_samples *out, error *e);
void cell_samples_free(cell_samples *s);

#endif
