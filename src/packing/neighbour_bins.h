/* neighbour_bins: the bins and blocks of neighbour lists: where they are, and which points lie in them. A part of neighbours, whose
 * header tells what they are; no others include it. */
#ifndef HEXAD_PACKING_NEIGHBOUR_BINS_H
#define HEXAD_PACKING_NEIGHBOUR_BINS_H

#include "packing/neighbours.h"

#define BLOCK_SHIFT 3 /* a block is this power of two of bins wide: what it reads fits into a core's cache */
#define BLOCK_BITS 16 /* of a block's coordinate; in a block's key the level stands above the three */
#define BLOCK_WIDTH (1 << BLOCK_SHIFT)
#define BLOCK_CELLS (1 << 3 * BLOCK_SHIFT)
#define CELL_BIN 0x3ff /* of a cell: the number of its bin within the block + 1, or 0 where there is none */
#define CELL_SPLIT 0x8000 /* bins of the level below lie in it */

/* Where a bin is, in edges of its level, or a block, in blocks. */
typedef struct place {
    int level;
    int64_t at[3];
} place;

static inline uint64_t key_of(const place *block)
{
    return (uint64_t)block->at[0] | (uint64_t)block->at[1] << BLOCK_BITS |
           (uint64_t)block->at[2] << 2 * BLOCK_BITS | (uint64_t)block->level << 3 * BLOCK_BITS;
}

static inline place block_of(const place *bin)
{
    return (place){bin->level,
                   {bin->at[0] >> BLOCK_SHIFT, bin->at[1] >> BLOCK_SHIFT, bin->at[2] >> BLOCK_SHIFT}};
}

static inline place place_of_block(uint64_t key)
{
    const uint64_t mask = ((uint64_t)1 << BLOCK_BITS) - 1;
    return (place){(int)(key >> 3 * BLOCK_BITS),
                   {(int64_t)(key & mask), (int64_t)(key >> BLOCK_BITS & mask),
                    (int64_t)(key >> 2 * BLOCK_BITS & mask)}};
}

/* A bin's cell in its block. */
static inline uint32_t cell_of(const place *bin)
{
    const int64_t mask = BLOCK_WIDTH - 1;
    return (uint32_t)((bin->at[0] & mask) | (bin->at[1] & mask) << BLOCK_SHIFT |
                      (bin->at[2] & mask) << 2 * BLOCK_SHIFT);
}

static inline place place_of_bin(const place *block, uint32_t cell)
{
    place p = *block;
    for (int a = 0; a < 3; a++)
        p.at[a] = p.at[a] << BLOCK_SHIFT | (cell >> a * BLOCK_SHIFT & (BLOCK_WIDTH - 1));
    return p;
}

/* The slot of a key: where its block is, or where it would go. */
static inline size_t slot_of(const neighbours *n, uint64_t key)
{
    size_t slot = (size_t)((key ^ key >> 29) * 0x9e3779b97f4a7c15u >> 32) & (n->table_size - 1);
    while (n->table[slot] && n->block_key[n->table[slot] - 1] != key) slot = (slot + 1) & (n->table_size - 1);
    return slot;
}

#define NO_KEY UINT64_MAX /* of no block */

/* Room for the bins and blocks of so many points on a surface; it grows when they have more. Error: limit_memory. */
bool neighbour_bins_reserve(neighbours *n, size_t points, error *e);

/* Puts the points into bins, and bins and blocks into their orders, by places, sizes, edge and cutoff. list, list_begin and list_count
 * are used on the way, and mean nothing until there are lists. Errors: limit_memory, cancelled. */
bool neighbour_bins_fill(neighbours *n, threads *pool, error *e);

#endif
