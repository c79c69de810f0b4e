// SPDX-License-Identifier: Apache-2.0
/* neighbour_bins: positions and points of the bins and blocks of neighbour lists (neighbours.h). Private to
 * neighbours.c and independent_sets.c. */
#ifndef HEXAD_SAMPLING_PACKING_NEIGHBOUR_BINS_H
#define HEXAD_SAMPLING_PACKING_NEIGHBOUR_BINS_H

#include "sampling/packing/neighbours.h"

#define BLOCK_SHIFT \
    3 /* log2 of the width of a block in bins: the data of a block fit into the cache of a core */
#define BLOCK_BITS \
    16 /* bits of a coordinate in the key of a block; the level is above the three coordinates */
#define BLOCK_WIDTH (1 << BLOCK_SHIFT)
#define BLOCK_CELLS (1 << 3 * BLOCK_SHIFT)
#define CELL_BIN 0x3ff    /* bits of a cell: the number of its bin within the block + 1; 0: it has none */
#define CELL_SPLIT 0x8000 /* bit of a cell: it contains bins of the level below */

/* The position of a bin in edges of its level, or of a block in blocks. */
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

/* The cell of a bin in its block. */
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

/* The slot of a key in the hash table: that of its block, or a free one. */
static inline size_t slot_of(const neighbours *n, uint64_t key)
{
    size_t slot = (size_t)((key ^ key >> 29) * 0x9e3779b97f4a7c15u >> 32) & (n->table_size - 1);
    while (n->table[slot] && n->block_key[n->table[slot] - 1] != key) slot = (slot + 1) & (n->table_size - 1);
    return slot;
}

#define NO_KEY UINT64_MAX

/* Allocates bins and blocks for the typical number of `points` points on a surface; they grow later if
 * necessary. Error: limit_memory. */
bool neighbour_bins_reserve(neighbours *n, size_t points, error *e);

/* Sorts the points into bins, and bins and blocks into the order of updates. Input: place, edge and cutoff.
 * Uses list, list_begin and list_count as scratch memory. Errors: limit_memory, cancelled. */
bool neighbour_bins_fill(neighbours *n, threads *pool, error *e);

#endif
