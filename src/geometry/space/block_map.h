// SPDX-License-Identifier: Apache-2.0
/* block_map: a sparse set of blocks of 8^3 voxels, numbered in the order in which they were added.
 *
 * The coordinates of a block are the coordinates of its lowest voxel divided by 8; any int32 is valid. A node
 * holds the numbers of 4^3 blocks. A hash table with open addressing holds the nodes: a surface crosses few
 * of them, so that the table stays in the cache.
 * Complexity for n blocks: insertion O(1), amortised; search O(1); memory block_map_bytes(n). Blocks are
 * never removed. Reading: any number of threads, while no block is added.
 */
#ifndef HEXAD_GEOMETRY_SPACE_BLOCK_MAP_H
#define HEXAD_GEOMETRY_SPACE_BLOCK_MAP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"

#define BLOCK_MAP_NONE UINT32_MAX

enum { BLOCK_MAP_NODE = 64 }; /* blocks in a node: 4^3 */

typedef struct block_map_slot {
    int32_t key[3]; /* block coordinates by 4, rounded down */
    uint32_t node;  /* BLOCK_MAP_NONE: the slot is free */
} block_map_slot;

typedef struct block_map {
    block_map_slot *slots;
    uint32_t (*nodes)[BLOCK_MAP_NODE]; /* numbers of blocks, or BLOCK_MAP_NONE */
    int32_t (*blocks)[3];              /* by number */
    uint32_t mask;                     /* slots minus one */
    uint32_t count, node_count;
    size_t room, node_room;
    /* bytes; set after the map is created. A block that would exceed it is not added (limit_memory). 0: no
     * limit */
    size_t limit;
} block_map;

/* Allocates capacity for `expected` blocks; the map grows beyond it. A zeroed struct may be freed. */
bool block_map_init(block_map *m, size_t expected, error *e);
void block_map_free(block_map *m);

/* Copies the blocks and their numbers. Error: limit_memory, *out unchanged. */
bool block_map_copy(const block_map *m, block_map *out, error *e);

/* Adds a block unless the map has it. *number (NULL is permitted): its number. Error: limit_memory. */
bool block_map_find_or_add(block_map *m, int32_t x, int32_t y, int32_t z, uint32_t *number, error *e);

/* Maximum bytes of a map with `count` blocks of a surface. For scattered blocks, each in a node of its own,
 * it is six times as much. */
size_t block_map_bytes(size_t count);

static inline uint32_t block_map_hash(int32_t x, int32_t y, int32_t z)
{
    /* Three odd constants spread neighbours over the table. The last step mixes high bits into the low
     * ones. */
    const uint64_t h = (uint64_t)(uint32_t)x * 0x9E3779B97F4A7C15u +
                       (uint64_t)(uint32_t)y * 0xC2B2AE3D27D4EB4Fu +
                       (uint64_t)(uint32_t)z * 0x165667B19E3779F9u;
    return (uint32_t)(h ^ (h >> 32));
}

/* The slot of a node, or the free slot for it. */
static inline block_map_slot *block_map_slot_of(const block_map *m, const int32_t key[3])
{
    for (uint32_t i = block_map_hash(key[0], key[1], key[2]) & m->mask;; i = (i + 1) & m->mask) {
        block_map_slot *s = &m->slots[i];
        if (s->node == BLOCK_MAP_NONE || (s->key[0] == key[0] && s->key[1] == key[1] && s->key[2] == key[2]))
            return s;
    }
}

static inline int block_map_in_node(int32_t x, int32_t y, int32_t z)
{
    return (x & 3) << 4 | (y & 3) << 2 | (z & 3);
}

static inline uint32_t block_map_find(const block_map *m, int32_t x, int32_t y, int32_t z)
{
    const block_map_slot *s = block_map_slot_of(m, (const int32_t[]){x >> 2, y >> 2, z >> 2});
    return s->node == BLOCK_MAP_NONE ? BLOCK_MAP_NONE : m->nodes[s->node][block_map_in_node(x, y, z)];
}

/* The node of the last lookup; zeroed: none. Adding a block to the map invalidates it. */
typedef struct block_map_seen {
    int32_t key[3];
    const uint32_t *node;
} block_map_seen;

/* block_map_find, faster if successive lookups are of blocks near each other. */
static inline uint32_t block_map_find_near(const block_map *m, int32_t x, int32_t y, int32_t z,
                                           block_map_seen *seen)
{
    const int32_t key[3] = {x >> 2, y >> 2, z >> 2};
    if (!seen->node || key[0] != seen->key[0] || key[1] != seen->key[1] || key[2] != seen->key[2]) {
        const block_map_slot *s = block_map_slot_of(m, key);
        if (s->node == BLOCK_MAP_NONE) return BLOCK_MAP_NONE;
        *seen = (block_map_seen){{key[0], key[1], key[2]}, m->nodes[s->node]};
    }
    return seen->node[block_map_in_node(x, y, z)];
}

/* The numbers of a block and its 26 neighbours, or BLOCK_MAP_NONE: the block at offset (i, j, k), each -1 ..
 * 1, in out[9 i + 3 j + k + 13]. Faster than 27 lookups, since the blocks lie in at most 8 nodes. No
 * coordinate of the block is INT32_MIN or INT32_MAX. */
static inline void block_map_around(const block_map *m, const int32_t block[3], uint32_t out[27])
{
    static const uint32_t none[BLOCK_MAP_NODE] = {[0 ... BLOCK_MAP_NODE - 1] = BLOCK_MAP_NONE};
    const uint32_t *node[8];
    int32_t low[3];
    bool is_high[3][3]; /* whether the offset -1, 0 or 1 along an axis is in the higher node */
    for (int a = 0; a < 3; a++) {
        low[a] = (block[a] - 1) >> 2;
        for (int i = 0; i < 3; i++) is_high[a][i] = (block[a] + i - 1) >> 2 != low[a];
    }
    for (int k = 0; k < 8; k++) {
        const int step[3] = {k & 1, k >> 1 & 1, k >> 2};
        if ((step[0] && !is_high[0][2]) || (step[1] && !is_high[1][2]) || (step[2] && !is_high[2][2]))
            continue;
        const block_map_slot *s =
            block_map_slot_of(m, (const int32_t[]){low[0] + step[0], low[1] + step[1], low[2] + step[2]});
        node[k] = s->node == BLOCK_MAP_NONE ? none : m->nodes[s->node];
    }
    for (int k = 0; k < 27; k++) {
        const int i = k / 9, j = k / 3 % 3, l = k % 3;
        out[k] = node[is_high[0][i] + 2 * is_high[1][j] + 4 * is_high[2][l]]
                     [block_map_in_node(block[0] + i - 1, block[1] + j - 1, block[2] + l - 1)];
    }
}

#endif
