// SPDX-License-Identifier: Apache-2.0
/* coefficient block: spline coefficients of a volume, in one coefficient block per block, and the sides of
 * its samples.
 *
 * A coefficient block has the coefficients that the 8^3 cells of a block need: from -1 to +9 along each axis
 * relative to the block's lowest voxel, contiguous, the third axis fastest. They are floats, since sampling
 * is limited by memory bandwidth. The caller owns all arrays. `pool` may be NULL; results do not depend on
 * its number of threads, and are incomplete if it was stopped.
 *
 * If few places will be sampled, coefficient blocks are made on first access: a surface has many more, and
 * the first access to their memory takes longer than filling it. Only a limited number is stored; for other
 * coefficient blocks the coefficients of a cell are gathered on each access.
 */
#ifndef HEXAD_SURFACE_VOLUME_COEFFICIENT_BLOCK_H
#define HEXAD_SURFACE_VOLUME_COEFFICIENT_BLOCK_H

#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/threads.h"
#include "surface/volume/samples.h"

#define COEFFICIENT_BLOCK_SIDE 11
#define COEFFICIENT_BLOCK_SLAB (COEFFICIENT_BLOCK_SIDE * COEFFICIENT_BLOCK_SIDE)
#define COEFFICIENT_BLOCK_SIZE (COEFFICIENT_BLOCK_SIDE * COEFFICIENT_BLOCK_SLAB)

typedef struct coefficient_blocks {
    const block_map *map; /* owned by the caller */
    float *memory;        /* COEFFICIENT_BLOCK_SIZE floats for each of `capacity` coefficient blocks */
    size_t capacity;
    /* NULL: all coefficient blocks exist, in the order of blocks. Otherwise one state per block, and at the
     * end the number of coefficient blocks that exist. */
    atomic_uint *place;
    samples source; /* source of coefficient blocks that are made later; empty if all exist */
} coefficient_blocks;

/* States of a coefficient block; other values are COEFFICIENT_BLOCK_PRESENT plus its index in `memory`. */
enum { COEFFICIENT_BLOCK_MISSING, COEFFICIENT_BLOCK_IN_PROGRESS, COEFFICIENT_BLOCK_PRESENT };

/* The number of coefficient blocks to store if they are made on first access, or 0: make all at once. They
 * are made on first access if there are so many that touching their memory is slow, and `points` (0: unknown)
 * access only a few. */
size_t coefficient_blocks_capacity(size_t blocks, size_t points);

/* Makes coefficient blocks from samples that are coefficients. `later` 0: all at once; the memory of the
 * samples is freed progressively, if the blocks of the map are roughly sorted by their first coordinate.
 * Otherwise on first access, with storage for `later` coefficient blocks. Takes ownership of the samples,
 * also on failure. Error: limit_memory. */
bool coefficient_blocks_build(samples *s, const block_map *map, size_t later, threads *pool,
                              coefficient_blocks *out, error *e);
void coefficient_blocks_free(coefficient_blocks *b);

/* Makes the coefficient block of block n, or waits until another thread has made it. NULL: the storage is
 * full. */
const float *coefficient_blocks_wait(const coefficient_blocks *b, uint32_t n);

/* The coefficient block of block n, or NULL if the storage is full. Any thread. */
static inline const float *coefficient_blocks_at(const coefficient_blocks *b, uint32_t n)
{
    if (!b->place) return b->memory + (size_t)n * COEFFICIENT_BLOCK_SIZE;
    const unsigned place = atomic_load_explicit(&b->place[n], memory_order_acquire);
    return place < COEFFICIENT_BLOCK_PRESENT
               ? coefficient_blocks_wait(b, n)
               : b->memory + (size_t)(place - COEFFICIENT_BLOCK_PRESENT) * COEFFICIENT_BLOCK_SIZE;
}

/* The coefficient block of block n for a single access: a coefficient block that does not exist is computed
 * in `buffer` and not stored. Never NULL. */
const float *coefficient_blocks_read_once(const coefficient_blocks *b, uint32_t n,
                                          float buffer[COEFFICIENT_BLOCK_SIZE]);

/* Discards coefficient blocks that were made on first access. No thread may hold a coefficient block. */
void coefficient_blocks_discard(const coefficient_blocks *b);

/* The first coefficient of cell (x, y, z) of a coefficient block: `corner` of spline.h. */
static inline const float *coefficient_block_cell(const float *coefficients, int x, int y, int z)
{
    return coefficients + x * COEFFICIENT_BLOCK_SLAB + y * COEFFICIENT_BLOCK_SIDE + z;
}

/* Gathers the coefficients of one cell into `buffer`, with the strides of a coefficient block. */
enum { COEFFICIENT_BLOCK_CELL = 3 * COEFFICIENT_BLOCK_SLAB + 3 * COEFFICIENT_BLOCK_SIDE + 4 };
void coefficient_blocks_gather_cell(const coefficient_blocks *b, uint32_t n, const int cell[3],
                                    float buffer[COEFFICIENT_BLOCK_CELL]);

/* The first coefficient of a cell of block n, in its coefficient block or in `buffer`. */
static inline const float *coefficient_blocks_find_cell(const coefficient_blocks *b, uint32_t n,
                                                        const int cell[3],
                                                        float buffer[COEFFICIENT_BLOCK_CELL])
{
    const float *coefficients = coefficient_blocks_at(b, n);
    if (coefficients) return coefficient_block_cell(coefficients, cell[0], cell[1], cell[2]);
    coefficient_blocks_gather_cell(b, n, cell, buffer);
    return buffer;
}

/* Sets 8 words for each block of the map: bits of voxels that are inside, as the active flags of vdb.h. */
void coefficient_block_set_sides(const samples *s, const block_map *map, uint64_t *inside);

#endif
