// SPDX-License-Identifier: Apache-2.0
/* stencil: the samples of a lattice that an interpolated value depends on, and their weights. Index space.
 * Pure functions.
 */
#ifndef HEXAD_JOB_ATTRIBUTES_STENCIL_H
#define HEXAD_JOB_ATTRIBUTES_STENCIL_H

#include <stdbool.h>
#include <stdint.h>

#include "geometry/space/vec3.h"

typedef enum stencil_kind {
    STENCIL_LINEAR,
    /* Catmull-Rom: interpolates the samples; the slope at a sample is that of the neighbouring samples */
    STENCIL_CUBIC,
    STENCIL_NEAREST
} stencil_kind;

/* `count` samples along each axis, beginning at `first`. The weights along an axis sum to 1. */
typedef struct stencil {
    int count;
    int32_t first[3];
    double weight[3][4];
} stencil;

/* False if the position is beyond the range of indices. */
bool stencil_at(stencil_kind kind, vec3 index, stencil *out);

#endif
