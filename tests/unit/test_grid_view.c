// SPDX-License-Identifier: Apache-2.0
/* The contents of a block and of its neighbourhood: leaves, tiles of each size, and the background. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "base/core/memory.h"
#include "base/core/rng.h"
#include "shapes.h"
#include "surface/volume/grid_view.h"

enum { LEAVES = 400, TILES = 3000, LOOKS = 4000, REACH = 600 /* blocks */ };
static const float BACKGROUND = -7;

static int32_t random_within(rng *r, int reach)
{
    return (int32_t)(rng_uniform(r) * 2 * reach) - reach;
}

/* One of sixteen tiles of the largest size and one of four of the middle size exists. Leaves lie close to the
 * origin. No two leaves or tiles of a size coincide, since the tables contain each once. */
static vdb_grid make_grid(rng *r)
{
    error e = {0};
    vdb_grid g = {.grid_class = VDB_LEVEL_SET, .background = BACKGROUND};
    block_map seen[GRID_VIEW_TILE_LEVELS + 1];
    for (int k = 0; k <= GRID_VIEW_TILE_LEVELS; k++) assert_true(block_map_init(&seen[k], 0, &e));
    g.leaf_origin = mem_array(LEAVES, sizeof *g.leaf_origin, "leaves", &e);
    g.leaf_values = mem_array(LEAVES, GRID_VIEW_VOXELS * sizeof *g.leaf_values, "leaves", &e);
    g.leaf_active = mem_array(LEAVES, 8 * sizeof *g.leaf_active, "leaves", &e);
    g.tiles = mem_array(TILES, sizeof *g.tiles, "tiles", &e);
    for (int k = 0; k < LEAVES + TILES; k++) {
        const int level = k % 16 == 0  ? 2
                          : k % 4 == 0 ? 1
                                       : 0,
                  side = k < LEAVES   ? 8
                         : level == 2 ? 4096
                         : level == 1 ? 128
                                      : 8;
        const int reach = side == 4096 ? 3 : side == 128 ? 30 : 12;
        block_map *map = &seen[k < LEAVES ? GRID_VIEW_TILE_LEVELS : level];
        const int32_t at[3] = {random_within(r, reach), random_within(r, reach), random_within(r, reach)};
        const uint32_t before = map->count;
        assert_true(block_map_find_or_add(map, at[0], at[1], at[2], NULL, &e));
        if (map->count == before) continue;
        int32_t *origin = k < LEAVES ? g.leaf_origin[g.leaf_count++] : g.tiles[g.tile_count].origin;
        for (int a = 0; a < 3; a++) origin[a] = at[a] * side;
        if (k < LEAVES) continue;
        g.tiles[g.tile_count].side = side;
        g.tiles[g.tile_count++].value = (float)k;
    }
    for (int k = 0; k <= GRID_VIEW_TILE_LEVELS; k++) block_map_free(&seen[k]);
    return g;
}

/* The block by a linear search: a leaf, otherwise the smallest tile. */
static float constant_of(const vdb_grid *g, const int32_t block[3], bool *is_leaf)
{
    float found = BACKGROUND;
    int32_t smallest = INT32_MAX;
    *is_leaf = false;
    for (size_t n = 0; n < g->leaf_count; n++) {
        const int32_t *o = g->leaf_origin[n];
        *is_leaf |= o[0] == 8 * block[0] && o[1] == 8 * block[1] && o[2] == 8 * block[2];
    }
    for (size_t n = 0; n < g->tile_count; n++) {
        const vdb_tile *t = &g->tiles[n];
        bool within = t->side < smallest;
        for (int a = 0; a < 3; a++)
            within = within && 8 * block[a] >= t->origin[a] && 8 * block[a] < t->origin[a] + t->side;
        if (!within) continue;
        smallest = t->side;
        found = t->value;
    }
    return found;
}

static void blocks_are_leaves_or_the_smallest_tile(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    error e = {0};
    vdb_grid g = make_grid(&r);
    grid_view view;
    size_t leaves = 0;
    assert_true(grid_view_init(&view, &g, GRID_VIEW_LEVEL_SET, 0, SIZE_MAX, NULL, &e));
    for (int k = 0; k < LOOKS; k++) {
        const int reach = k % 2 ? 14 : REACH;
        const int32_t at[3] = {random_within(&r, reach), random_within(&r, reach), random_within(&r, reach)};
        grid_view_block around[27];
        bool is_leaf;
        const float constant = constant_of(&g, at, &is_leaf);
        grid_view_around(&view, at, around);
        for (int i = 0; i < 27; i++) {
            const grid_view_block one =
                grid_view_find(&view, at[0] + i / 9 - 1, at[1] + i / 3 % 3 - 1, at[2] + i % 3 - 1);
            assert_int_equal(around[i].leaf, one.leaf);
            if (one.leaf == BLOCK_MAP_NONE) assert_true(around[i].constant == one.constant);
        }
        assert_int_equal(around[13].leaf != BLOCK_MAP_NONE, is_leaf);
        if (!is_leaf) assert_true(around[13].constant == constant);
        leaves += is_leaf;
    }
    assert_true(leaves > 0);
    grid_view_free(&view);
    free(g.leaf_origin);
    free(g.leaf_values);
    free(g.leaf_active);
    free(g.tiles);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(blocks_are_leaves_or_the_smallest_tile)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
