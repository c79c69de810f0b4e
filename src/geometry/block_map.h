/* block_map: a set of 8^3 blocks of the index space, numbered in the order in which they were added.
 *
 * A block's coordinates are its lowest voxel's divided by 8. Any int32 coordinates will do. Open
 * addressing, a key and its number in one slot of 16 bytes, so that a lookup touches one cache line.
 * Nothing is ever removed. Reading is safe in any number of threads once nothing is added any more.
 */
#ifndef HEXAD_GEOMETRY_BLOCK_MAP_H
#define HEXAD_GEOMETRY_BLOCK_MAP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"

#define BLOCK_MAP_NONE UINT32_MAX

typedef struct block_map_slot {
    int32_t key[3];
    uint32_t number; /* BLOCK_MAP_NONE: the slot is free */
} block_map_slot;

typedef struct block_map {
    block_map_slot *slots;
    int32_t (*blocks)[3]; /* by number */
    uint32_t mask;        /* slots minus one */
    uint32_t count, room;
} block_map;

/* Room for `expected` blocks; it grows beyond. A zeroed struct may be freed. */
bool block_map_init(block_map *m, size_t expected, error *e);
void block_map_free(block_map *m);

/* The block's number in *number (which may be NULL), old or new. False when memory is out. */
bool block_map_find_or_add(block_map *m, int32_t x, int32_t y, int32_t z, uint32_t *number, error *e);

/* Bytes that a map of `count` blocks takes at most. */
size_t block_map_bytes(size_t count);

static inline uint32_t block_map_hash(int32_t x, int32_t y, int32_t z)
{
    /* Two neighbours along z have slots side by side, in one cache line. Three odd constants spread the pairs over the table; the
     * final fold brings high bits down. */
    const uint64_t h = (uint64_t)(uint32_t)x * 0x9E3779B97F4A7C15u +
                       (uint64_t)(uint32_t)y * 0xC2B2AE3D27D4EB4Fu +
                       (uint64_t)((uint32_t)z >> 1) * 0x165667B19E3779F9u;
    return (uint32_t)(h ^ (h >> 32)) << 1 | ((uint32_t)z & 1);
}

static inline uint32_t block_map_find(const block_map *m, int32_t x, int32_t y, int32_t z)
{
    for (uint32_t i = block_map_hash(x, y, z) & m->mask;; i = (i + 1) & m->mask) {
        const block_map_slot *s = &m->slots[i];
        if (s->number == BLOCK_MAP_NONE) return BLOCK_MAP_NONE;
        if (s->key[0] == x && s->key[1] == y && s->key[2] == z) return s->number;
    }
}

#endif
