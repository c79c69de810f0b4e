// SPDX-License-Identifier: Apache-2.0
#include "geometry/space/block_map.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

static const char what[] = "the table of blocks";

/* Slots are kept at most half full: a miss then ends after about one and a half probes. */
#define SLOTS_PER_NODE 2
#define SMALLEST_ROOM 16
/* A surface has some 20 blocks in a node. */
#define BLOCKS_PER_NODE 8

/* Allocates slots for `nodes` nodes, and moves the existing nodes into them. */
static bool make_slots(block_map *m, size_t nodes, error *e)
{
    const block_map old = *m;
    size_t slots = SLOTS_PER_NODE * SMALLEST_ROOM;
    while (slots < SLOTS_PER_NODE * nodes) slots *= 2;
    if (slots > (size_t)1 << 31)
        return error_set(e, ERROR_LIMIT_MEMORY, "needs more than %zu nodes of 4^3 blocks", (size_t)1 << 30);
    block_map_slot *made = mem_array(slots, sizeof *made, what, e);
    if (!made) return false;
    for (size_t i = 0; i < slots; i++) made[i].node = BLOCK_MAP_NONE;
    m->slots = made;
    m->mask = (uint32_t)(slots - 1);
    for (size_t i = 0; old.slots && i <= old.mask; i++)
        if (old.slots[i].node != BLOCK_MAP_NONE) *block_map_slot_of(m, old.slots[i].key) = old.slots[i];
    free(old.slots);
    return true;
}

bool block_map_init(block_map *m, size_t expected, error *e)
{
    memset(m, 0, sizeof *m);
    m->room = expected > SMALLEST_ROOM ? expected : SMALLEST_ROOM;
    m->node_room = m->room / BLOCKS_PER_NODE;
    m->blocks = mem_array(m->room, sizeof *m->blocks, what, e);
    m->nodes = mem_array(m->node_room, sizeof *m->nodes, what, e);
    if (m->blocks && m->nodes && make_slots(m, m->node_room, e)) return true;
    block_map_free(m);
    return false;
}

void block_map_free(block_map *m)
{
    free(m->slots);
    free(m->nodes);
    free(m->blocks);
    memset(m, 0, sizeof *m);
}

static void *copied(const void *from, size_t count, size_t room, size_t size, error *e)
{
    void *to = mem_array(room, size, what, e);
    if (to && count > 0) memcpy(to, from, count * size);
    return to;
}

bool block_map_copy(const block_map *m, block_map *out, error *e)
{
    const size_t slots = (size_t)m->mask + 1;
    block_map made = *m;
    made.blocks = copied(m->blocks, m->count, m->room, sizeof *m->blocks, e);
    made.nodes = copied(m->nodes, m->node_count, m->node_room, sizeof *m->nodes, e);
    made.slots = copied(m->slots, slots, slots, sizeof *m->slots, e);
    if (made.blocks && made.nodes && made.slots) {
        *out = made;
        return true;
    }
    block_map_free(&made);
    return false;
}

/* Returns the number of the new node, or BLOCK_MAP_NONE if memory is exhausted. */
static uint32_t add_node(block_map *m, const int32_t key[3], error *e)
{
    if (!MEM_GROW(m->nodes, m->node_count, &m->node_room, what, e)) return BLOCK_MAP_NONE;
    const size_t slots = (size_t)m->mask + 1;
    if (SLOTS_PER_NODE * (size_t)m->node_count == slots && !make_slots(m, slots, e)) return BLOCK_MAP_NONE;
    /* all entries become BLOCK_MAP_NONE */
    memset(m->nodes[m->node_count], 0xFF, sizeof *m->nodes);
    *block_map_slot_of(m, key) = (block_map_slot){{key[0], key[1], key[2]}, m->node_count};
    return m->node_count++;
}

static size_t held(const block_map *m)
{
    return m->room * sizeof *m->blocks + m->node_room * sizeof *m->nodes +
           ((size_t)m->mask + 1) * sizeof *m->slots;
}

static bool add(block_map *m, const int32_t block[3], error *e)
{
    const int32_t key[3] = {block[0] >> 2, block[1] >> 2, block[2] >> 2};
    if (m->count == BLOCK_MAP_NONE)
        return error_set(e, ERROR_LIMIT_MEMORY, "needs more than %u blocks of 8^3 voxels", m->count);
    if (m->limit > 0 && held(m) > m->limit)
        return error_set(
            e, ERROR_LIMIT_MEMORY,
            "the table of %u blocks of 8^3 voxels takes too much of the memory limit: raise limits.memory_mb",
            m->count);
    if (!MEM_GROW(m->blocks, m->count, &m->room, what, e)) return false;
    uint32_t node = block_map_slot_of(m, key)->node;
    if (node == BLOCK_MAP_NONE && (node = add_node(m, key, e)) == BLOCK_MAP_NONE) return false;
    memcpy(m->blocks[m->count], block, sizeof *m->blocks);
    m->nodes[node][block_map_in_node(block[0], block[1], block[2])] = m->count++;
    return true;
}

bool block_map_find_or_add(block_map *m, int32_t x, int32_t y, int32_t z, uint32_t *number, error *e)
{
    uint32_t found = block_map_find(m, x, y, z);
    if (found == BLOCK_MAP_NONE) {
        found = m->count;
        if (!add(m, (const int32_t[]){x, y, z}, e)) return false;
    }
    if (number) *number = found;
    return true;
}

size_t block_map_bytes(size_t count)
{
    const size_t room = count + SMALLEST_ROOM;
    return room * sizeof(int32_t[3]) +
           room / BLOCKS_PER_NODE * (sizeof(uint32_t[BLOCK_MAP_NODE]) + 4 * sizeof(block_map_slot));
}
