// SPDX-License-Identifier: Apache-2.0
/* bent_areas: areas of the cells within which the surface bends. If there are many such cells, most areas are
 * estimated from samples.
 *
 * The area of a cell is computed from 4^3 parts or, in less time, from 2^3 parts or from the triangles of the
 * whole cell. The faster estimates are too small by a ratio that is similar for similar cells. At 8 000 cells
 * or more, at most one of eight cells is measured by all parts; at 50 000 or more, others are measured by
 * half as many parts along each axis. The errors are then about 4e-4 for fogs and 1.3e-3 for noise. Units:
 * world, squared. No state, any thread.
 */
#ifndef HEXAD_SURFACE_SCAN_BENT_AREAS_H
#define HEXAD_SURFACE_SCAN_BENT_AREAS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Sums of areas, and a number of cells. Cells measured by all parts: `whole`, the area by all parts;
 * `half_of_whole`, the area by half as many parts along each axis; `wholes`, their number. Cells measured by
 * half of the parts: `half`, the area by these parts; `rough_of_half`, the area by the triangles of the
 * cell. */
typedef struct bent_sums {
    double whole, half_of_whole, half, rough_of_half;
    size_t wholes;
} bent_sums;

/* One of `whole` bent cells is measured by all parts, and one of `half` by half as many along each axis;
 * `whole` is a multiple of `half`. Both 1: all cells are measured by all parts. */
typedef struct bent_samples {
    uint32_t whole, half;
} bent_samples;

/* Returns the samples for this number of bent cells. */
bent_samples bent_choose(double cells);

/* Whether cell k belongs to the sample of one of `every` cells. */
bool bent_is_drawn(size_t k, uint32_t every);

/* Replaces the estimates in area[0 .. cells - 1]. An estimate is stored with a negative sign: by half of the
 * parts if the cell is in that sample, otherwise by the triangles of the cell. Estimates are scaled by the
 * ratios of the sampled cells of the same stretch, since the shape of a surface varies with the position.
 * `sums`: one element for each stretch of `grain` cells. */
void bent_settle(double *area, size_t cells, size_t grain, const bent_sums *sums, bent_samples every);

#endif
