/* brick: spline coefficients of a volume, in one brick per block, and the sides of its samples.
 *
 * A brick has the coefficients that the 8^3 cells of a block need: from -1 to +9 along each axis relative to the
 * block's lowest voxel, contiguous, the third axis fastest. They are floats, since sampling is limited by memory
 * bandwidth. The caller owns all arrays. `pool` may be NULL; results do not depend on its number of threads, and are
 * incomplete if it was stopped.
 *
 * If few places will be sampled, bricks are made on first access: a surface has many more, and the first access to
 * their memory takes longer than filling it. Only a limited number is stored; for other bricks the coefficients of a
 * cell are gathered on each access.
 */
#ifndef HEXAD_VOLUME_BRICK_H
#define HEXAD_VOLUME_BRICK_H

#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>

#include "base/threads.h"
#include "voxels/samples.h"

#define BRICK_SIDE 11
#define BRICK_SLAB (BRICK_SIDE * BRICK_SIDE)
#define BRICK_SIZE (BRICK_SIDE * BRICK_SLAB)

typedef struct bricks {
    const block_map *map; /* owned by the caller */
    float *memory;        /* BRICK_SIZE floats for each of `capacity` bricks */
    size_t capacity;
    atomic_uint *
        /* NULL: all bricks exist, in the order of blocks. Otherwise one state per block, and at the end the number of
         * bricks that exist. */
        place;
    samples coefficients; /* source of bricks that are made later; empty if all exist */
} bricks;

/* States of a brick; other values are BRICK_THERE plus its index in `memory`. */
enum { BRICK_MISSING, BRICK_BEING_MADE, BRICK_THERE };

/* The number of bricks to store if they are made on first access, or 0: make all at once. They are made on first access
 * if there are so many that touching their memory is slow, and `points` (0: unknown) access only a few. */
size_t bricks_capacity(size_t blocks, size_t points);

/* Makes bricks from samples that are coefficients. `later` 0: all at once; the memory of the samples is freed
 * progressively, if the blocks of the map are roughly sorted by their first coordinate. Otherwise on first access, with
 * storage for `later` bricks. Takes ownership of the samples, also on failure. Error: limit_memory. */
bool bricks_make(samples *s, const block_map *map, size_t later, threads *pool, bricks *out, error *e);
void bricks_free(bricks *b);

/* Makes the brick of block n, or waits until another thread has made it. NULL: the storage is full. */
const float *bricks_wait(const bricks *b, uint32_t n);

/* The brick of block n, or NULL if the storage is full. Any thread. */
static inline const float *bricks_at(const bricks *b, uint32_t n)
{
    if (!b->place) return b->memory + (size_t)n * BRICK_SIZE;
    const unsigned place = atomic_load_explicit(&b->place[n], memory_order_acquire);
    return place < BRICK_THERE ? bricks_wait(b, n) : b->memory + (size_t)(place - BRICK_THERE) * BRICK_SIZE;
}

/* The brick of block n for a single access: a brick that does not exist is computed in `buffer` and not stored. Never
 * NULL. */
const float *bricks_read_once(const bricks *b, uint32_t n, float buffer[BRICK_SIZE]);

/* Discards bricks that were made on first access. No thread may hold a brick. */
void bricks_forget(const bricks *b);

/* The first coefficient of cell (x, y, z) of a brick: `corner` of spline.h. */
static inline const float *brick_cell(const float *brick, int x, int y, int z)
{
    return brick + x * BRICK_SLAB + y * BRICK_SIDE + z;
}

/* Gathers the coefficients of one cell into `buffer`, with the strides of a brick. */
enum { BRICK_CELL = 3 * BRICK_SLAB + 3 * BRICK_SIDE + 4 };
void bricks_gather_cell(const bricks *b, uint32_t n, const int cell[3], float buffer[BRICK_CELL]);

/* The first coefficient of a cell of block n, in its brick or in `buffer`. */
static inline const float *bricks_find_cell(const bricks *b, uint32_t n, const int cell[3],
                                            float buffer[BRICK_CELL])
{
    const float *brick = bricks_at(b, n);
    if (brick) return brick_cell(brick, cell[0], cell[1], cell[2]);
    bricks_gather_cell(b, n, cell, buffer);
    return buffer;
}

/* Sets 8 words for each block of the map: bits of voxels that are inside, as the active flags of vdb.h. */
void brick_note_sides(const samples *s, const block_map *map, uint64_t *inside);

#endif
