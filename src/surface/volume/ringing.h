// SPDX-License-Identifier: Apache-2.0
/* ringing: finds cells that the spline of a volume crosses only because it overshoots beside a jump of the samples, as to
 * a value for "no data", and limits the samples of such jumps.
 *
 * The spline oscillates on both sides of a jump: by up to a tenth of it in the next cell, and by 0.27 of that in each
 * further one. A cell whose samples have one sign rings if the spline crosses it and the samples around it exceed its own
 * many times. Samples are limited to a multiple of those at the surface nearby, so that no overshoot reaches it. Units:
 * index space; F as in samples.h.
 */
#ifndef HEXAD_SURFACE_VOLUME_RINGING_H
#define HEXAD_SURFACE_VOLUME_RINGING_H

#include <stdbool.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/volume/coefficient_block.h"
#include "surface/volume/crossed_cells.h"
#include "surface/volume/samples.h"

/* The fraction of the cells that ring; 0 if it is at most a hundredth. *certain: a jump displaces the surface whatever the
 * fraction. Both are incomplete if the pool was stopped. */
double ringing_share(const coefficient_blocks *b, const crossed_cells *cells, threads *pool, bool *certain);

/* The fraction of the cells in which the samples of one side are many times as large as those of the other, as beside a
 * plateau next to the isovalue, and F bends there; 0 if it is at most 0.35, or of fewer than 1000 cells. `cells`: with F at their corners. */
double ringing_one_sided(const coefficient_blocks *b, const crossed_cells *cells);

/* Samples that were limited by more than a half: bits of 8 words for each block of the map of the cells, as in samples.h. */
typedef struct ringing_limits {
    uint64_t *limited; /* NULL: none */
    uint64_t count;    /* of known voxels */
    int32_t first[3];  /* one of them, and what it was */
    float was;
} ringing_limits;

/* Limits samples, before they become coefficients. `cells`: with F at their corners. Limits none if the surface passes
 * through the jump itself, which would move it. Error: limit_memory. */
bool ringing_limit(const crossed_cells *cells, samples *s, ringing_limits *out, error *e);

/* Whether a sample was limited among the 4^3 around a cell. */
bool ringing_is_limited(const ringing_limits *r, const block_map *map, const int32_t cell[3]);
void ringing_free(ringing_limits *r);

#endif
