#include "geometry/block_map.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

/* Slots are kept at most half full: a miss then ends after about one and a half probes. */
#define SLOTS_PER_BLOCK 2
#define SMALLEST_ROOM 16

static bool make(block_map *m, size_t room, error *e)
{
    size_t slots = SLOTS_PER_BLOCK * SMALLEST_ROOM;
    while (slots < SLOTS_PER_BLOCK * room) slots *= 2;
    if (slots > (size_t)1 << 31)
        return error_set(e, ERROR_LIMIT_MEMORY, "needs more than %zu blocks of 8^3 voxels", (size_t)1 << 30);
    m->slots = mem_array(slots, sizeof *m->slots, "the table of blocks", e);
    m->blocks = mem_array(slots / SLOTS_PER_BLOCK, sizeof *m->blocks, "the list of blocks", e);
    if (!m->slots || !m->blocks) {
        block_map_free(m);
        return false;
    }
    for (size_t i = 0; i < slots; i++) m->slots[i].number = BLOCK_MAP_NONE;
    m->mask = (uint32_t)(slots - 1);
    m->room = (uint32_t)(slots / SLOTS_PER_BLOCK);
    return true;
}

bool block_map_init(block_map *m, size_t expected, error *e)
{
    memset(m, 0, sizeof *m);
    return make(m, expected, e);
}

void block_map_free(block_map *m)
{
    free(m->slots);
    free(m->blocks);
    memset(m, 0, sizeof *m);
}

static void place(block_map *m, const int32_t block[3], uint32_t number)
{
    uint32_t i = block_map_hash(block[0], block[1], block[2]) & m->mask;
    while (m->slots[i].number != BLOCK_MAP_NONE) i = (i + 1) & m->mask;
    memcpy(m->slots[i].key, block, sizeof m->slots[i].key);
    m->slots[i].number = number;
}

static bool grow(block_map *m, error *e)
{
    block_map larger = {0};
    if (!make(&larger, (size_t)m->room * 2, e)) return false;
    for (uint32_t n = 0; n < m->count; n++) {
        memcpy(larger.blocks[n], m->blocks[n], sizeof larger.blocks[n]);
        place(&larger, m->blocks[n], n);
    }
    larger.count = m->count;
    block_map_free(m);
    *m = larger;
    return true;
}

bool block_map_find_or_add(block_map *m, int32_t x, int32_t y, int32_t z, uint32_t *number, error *e)
{
    uint32_t found = block_map_find(m, x, y, z);
    if (found == BLOCK_MAP_NONE) {
        if (m->count == m->room && !grow(m, e)) return false;
        found = m->count++;
        m->blocks[found][0] = x;
        m->blocks[found][1] = y;
        m->blocks[found][2] = z;
        place(m, m->blocks[found], found);
    }
    if (number) *number = found;
    return true;
}

size_t block_map_bytes(size_t count)
{
    size_t room = SMALLEST_ROOM;
    while (room < count) room *= 2;
    return room * (SLOTS_PER_BLOCK * sizeof(block_map_slot) + sizeof(int32_t[3]));
}
