/* brick: how the spline coefficients around a block are kept, and what else a volume keeps of its samples.
 *
 * A brick holds the coefficients that the 8^3 cells of a block need: from -1 to +9 along each axis relative to the
 * block's lowest voxel, contiguous, the third axis fastest. Floats, to halve the memory that sampling waits for.
 * The caller owns all arrays. Threads: those of a pool, or NULL; what comes out does not depend on their number. Where the
 * pool was told to stop it is not complete.
 *
 * Where few places will be looked at, bricks are made when somebody first looks at them: a surface has far more, and to
 * touch their memory takes longer than to fill it. There is room for so many of them; of others the coefficients of a cell
 * are gathered each time.
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
    const block_map *map; /* the caller's */
    float *memory;        /* BRICK_SIZE for each of `room` bricks */
    size_t room;
    atomic_uint *
        place; /* NULL: all are there, in the order of blocks. Else of each block, and at last how many there are */
    samples coefficients; /* of which bricks are made later; nothing where all are there */
} bricks;

/* What `place` says of a brick that is not there, or being made; others lie at their number less BRICK_THERE. */
enum { BRICK_MISSING, BRICK_BEING_MADE, BRICK_THERE };

/* Of bricks that are so many that to touch their memory takes long, and of which so many points leave most alone, how many
 * are to find room when they are looked at; 0: all are to be made at once. points 0: not known. */
size_t bricks_room(size_t blocks, size_t points);

/* Of samples that are coefficients. With no `later` all at once: then the samples' memory is given back as it goes, for which
 * blocks of the map come about in the order of their first coordinates. Or later, with room for so many. The samples are taken
 * over, also on failure. Error: limit_memory. */
bool bricks_make(samples *s, const block_map *map, size_t later, threads *pool, bricks *out, error *e);
void bricks_free(bricks *b);

/* Makes the brick of block n, unless another thread does, and waits until it is there. NULL: there is no room. */
const float *bricks_wait(const bricks *b, uint32_t n);

/* The brick of block n, or NULL. Any threads. */
static inline const float *bricks_at(const bricks *b, uint32_t n)
{
    if (!b->place) return b->memory + (size_t)n * BRICK_SIZE;
    const unsigned place = atomic_load_explicit(&b->place[n], memory_order_acquire);
    return place < BRICK_THERE ? bricks_wait(b, n) : b->memory + (size_t)(place - BRICK_THERE) * BRICK_SIZE;
}

/* The same for one who looks once: `room` is for a brick that is not there, and does not come to be. Never NULL. */
const float *bricks_glance(const bricks *b, uint32_t n, float room[BRICK_SIZE]);

/* Nobody holds a brick: those that were made later are not there, and their memory is for others. */
void bricks_forget(const bricks *b);

/* The first coefficient of a cell (x, y, z) of a brick, as spline.h wants it. */
static inline const float *brick_cell(const float *brick, int x, int y, int z)
{
    return brick + x * BRICK_SLAB + y * BRICK_SIDE + z;
}

/* Of a cell alone, in the steps of a brick. */
enum { BRICK_CELL = 3 * BRICK_SLAB + 3 * BRICK_SIDE + 4 };
void bricks_gather_cell(const bricks *b, uint32_t n, const int cell[3], float room[BRICK_CELL]);

/* The first coefficient of a cell of block n, in its brick or else in `room`. */
static inline const float *bricks_find_cell(const bricks *b, uint32_t n, const int cell[3],
                                            float room[BRICK_CELL])
{
    const float *brick = bricks_at(b, n);
    if (brick) return brick_cell(brick, cell[0], cell[1], cell[2]);
    bricks_gather_cell(b, n, cell, room);
    return room;
}

/* 8 words for each block of the map: voxels that are inside, as in vdb.h's active flags. */
void brick_note_sides(const samples *s, const block_map *map, uint64_t *inside);

#endif
