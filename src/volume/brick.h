/* brick: how the spline coefficients around a block are kept, and what else a volume keeps of its samples.
 *
 * A brick holds the coefficients that the 8^3 cells of a block need: from -1 to +9 along each axis relative to the
 * block's lowest voxel, contiguous, the third axis fastest. Floats, to halve the memory that sampling waits for.
 * The caller owns all arrays. Threads: those of a pool, or NULL; what comes out does not depend on their number. Where the
 * pool was told to stop it is not complete.
 */
#ifndef HEXAD_VOLUME_BRICK_H
#define HEXAD_VOLUME_BRICK_H

#include <stddef.h>
#include <stdint.h>

#include "base/threads.h"
#include "volume/crossings.h"
#include "volume/grazed.h"
#include "volume/samples.h"

#define BRICK_SIDE 11
#define BRICK_SLAB (BRICK_SIDE * BRICK_SIDE)
#define BRICK_SIZE (BRICK_SIDE * BRICK_SLAB)

/* The first coefficient of the cell (x, y, z) of block n, as spline.h wants it. */
static inline const float *brick_cell(const float *bricks, size_t n, int x, int y, int z)
{
    return bricks + n * BRICK_SIZE + x * BRICK_SLAB + y * BRICK_SIDE + z;
}

/* The bricks of the map's blocks, of samples that are coefficients. Blocks come about in the order of their first
 * coordinates; the samples' memory is given back as it goes, so that they are of no use afterwards. Error: limit_memory. */
bool brick_fill(samples *s, const block_map *map, threads *pool, float *bricks, error *e);

/* 8 words for each block of the map: voxels that are inside, as in vdb.h's active flags. Words are 0 before. */
void brick_note_sides(const samples *s, const block_map *map, threads *pool, uint64_t *inside);

/* c->cells of them, block after block. `smooth`: as in samples_corners. Error: limit_memory. */
bool brick_list_cells(const samples *s, const crossings *c, bool smooth, threads *pool, crossed_cell *cells,
                      error *e);

#endif
