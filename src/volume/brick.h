/* brick: how the spline coefficients around a block are kept.
 *
 * A brick holds the coefficients that the 8^3 cells of a block need: from -1 to +9 along each axis relative to the
 * block's lowest voxel, contiguous, the third axis fastest. Floats, to halve the memory that sampling waits for.
 */
#ifndef HEXAD_VOLUME_BRICK_H
#define HEXAD_VOLUME_BRICK_H

#include <stddef.h>

#define BRICK_SIDE 11
#define BRICK_SLAB (BRICK_SIDE * BRICK_SIDE)
#define BRICK_SIZE (BRICK_SIDE * BRICK_SLAB)

/* The first coefficient of the cell (x, y, z) of block n, as spline.h wants it. */
static inline const float *brick_cell(const float *bricks, size_t n, int x, int y, int z)
{
    return bricks + n * BRICK_SIZE + x * BRICK_SLAB + y * BRICK_SIDE + z;
}

#endif
