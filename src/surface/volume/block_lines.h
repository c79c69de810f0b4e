// SPDX-License-Identifier: Apache-2.0
/* block_lines: lines of voxels in blocks, for code that processes all of them. */
#ifndef HEXAD_SURFACE_VOLUME_BLOCK_LINES_H
#define HEXAD_SURFACE_VOLUME_BLOCK_LINES_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/core/lanes.h"
#include "surface/volume/grid_view.h"

_Static_assert(LANES == GRID_VIEW_SIDE, "a row of a block is what one instruction works on");

/* Offset from a voxel to the next one along each axis. */
static const int block_stride[3] = {64, 8, 1};

/* Prefetches the voxels of the next block: blocks are scattered in memory, which a hardware prefetcher cannot
 * predict. */
ISA_INLINE void block_fetch(const float *f)
{
#pragma GCC unroll 8
    for (int k = 0; k < GRID_VIEW_VOXELS; k += 16) __builtin_prefetch(f + k);
}

/* Transposes: bit 8 j + i becomes bit 8 i + j. Source: Warren, Hacker's Delight, section 7-3. */
ISA_INLINE uint64_t block_transposed(uint64_t m)
{
    uint64_t t = (m ^ m >> 7) & 0x00aa00aa00aa00aau;
    m ^= t ^ t << 7;
    t = (m ^ m >> 14) & 0x0000cccc0000ccccu;
    m ^= t ^ t << 14;
    t = (m ^ m >> 28) & 0x00000000f0f0f0f0u;
    return m ^ t ^ t << 28;
}

/* Byte k of each layer of a block, as a layer perpendicular to y instead of x. */
ISA_INLINE uint64_t block_turned(const uint64_t bits[GRID_VIEW_SIDE], int k)
{
    uint64_t layer = 0;
    for (int x = 0; x < GRID_VIEW_SIDE; x++) layer |= (bits[x] >> 8 * k & 0xff) << 8 * x;
    return layer;
}

/* The bits of row y of a layer, one per lane. */
ISA_INLINE lanes_mask block_row(uint64_t layer, int y)
{
    return lanes_spread((uint8_t)(layer >> GRID_VIEW_SIDE * y));
}

ISA_INLINE bool block_has_any(const uint64_t bits[GRID_VIEW_SIDE])
{
    uint64_t any = 0;
    for (int x = 0; x < GRID_VIEW_SIDE; x++) any |= bits[x];
    return any != 0;
}

/* The second difference for extrapolating a line beyond its voxels a, b, c, the nearest first. A gentle bend
 * is extrapolated as a parabola. A bend of more than half of the slope is an edge or noise, and a parabola
 * would be far off. For a ball of 10 voxels, limits of 0.25 to 1 of the slope give equally small errors; with
 * straight lines they are ten times larger. */
ISA_INLINE double block_line_bend(double a, double b, double c)
{
    const double most = 0.5 * fabs(a - b);
    double bend = a - 2 * b + c;
    bend = bend > most ? most : bend;
    return bend < -most ? -most : bend;
}

#endif
