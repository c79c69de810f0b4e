// SPDX-License-Identifier: Apache-2.0
/* The crossed cells equal those found cell by cell, whatever leaves and tiles the surface passes. Their
 * neighbourhoods are tested, too.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "base/core/memory.h"
#include "base/core/rng.h"
#include "shapes.h"
#include "surface/volume/crossings.h"
#include "surface/volume/grid_view.h"
#include "surface/volume/reach.h"

enum {
    SIDE = GRID_VIEW_SIDE,
    TILE = 16 /* blocks along a tile of 128^3 */,
    TILES = 3 /* along each axis */,
    FIRST = -TILE,
    ALL = TILES * TILE /* blocks along each axis */
};

typedef struct builder {
    vdb_grid grid;
    rng r;
} builder;

static void add_tile(vdb_grid *g, const int32_t block[3], int32_t side, float value)
{
    vdb_tile *t = &g->tiles[g->tile_count++];
    *t = (vdb_tile){{SIDE * block[0], SIDE * block[1], SIDE * block[2]}, side, value, false};
}

/* Blocks of two signs in clumps of 2^3, so that most have equal neighbours: tiles, no tile where the
 * background is, and leaves. */
static void divide(builder *b, const int32_t low[3])
{
    double clump[TILE / 2][TILE / 2][TILE / 2];
    for (int k = 0; k < TILE * TILE * TILE / 8; k++)
        clump[k / (TILE * TILE / 4)][k / (TILE / 2) % (TILE / 2)][k % (TILE / 2)] = rng_uniform(&b->r);
    for (int k = 0; k < TILE * TILE * TILE; k++) {
        const int x = k / (TILE * TILE), y = k / TILE % TILE, z = k % TILE;
        const int32_t block[3] = {low[0] + x, low[1] + y, low[2] + z};
        const double which = clump[x / 2][y / 2][z / 2];
        vdb_grid *g = &b->grid;
        if (which < 0.45) {
            add_tile(g, block, SIDE, -g->background);
        } else if (which < 0.5) {
            add_tile(g, block, SIDE, 2 * g->background);
        } else if (which < 0.55) {
            for (int a = 0; a < 3; a++) g->leaf_origin[g->leaf_count][a] = SIDE * block[a];
            for (int i = 0; i < GRID_VIEW_VOXELS; i++)
                g->leaf_values[g->leaf_count * GRID_VIEW_VOXELS + (size_t)i] =
                    (float)rng_uniform(&b->r) - 0.5f;
            g->leaf_count++;
        }
    }
}

static builder make(float background, uint64_t seed)
{
    const size_t blocks = (size_t)ALL * ALL * ALL;
    error e = {0};
    builder b = {{.background = background}, rng_seed(seed, 0)};
    b.grid.leaf_origin = mem_array(blocks, sizeof *b.grid.leaf_origin, "leaves", &e);
    b.grid.leaf_values = mem_array(blocks, GRID_VIEW_VOXELS * sizeof(float), "leaves", &e);
    b.grid.leaf_active = mem_array(blocks, SIDE * sizeof(uint64_t), "leaves", &e);
    b.grid.tiles = mem_array(blocks, sizeof *b.grid.tiles, "tiles", &e);
    for (int k = 0; k < TILES * TILES * TILES; k++) {
        const int32_t low[3] = {FIRST + TILE * (k / (TILES * TILES)), FIRST + TILE * (k / TILES % TILES),
                                FIRST + TILE * (k % TILES)};
        const double which = rng_uniform(&b.r);
        if (which < 0.4)
            add_tile(&b.grid, low, SIDE * TILE, which < 0.3 ? -background : background);
        else if (which < 0.8)
            divide(&b, low);
    }
    return b;
}

static void release(builder *b)
{
    free(b->grid.leaf_origin);
    free(b->grid.leaf_values);
    free(b->grid.leaf_active);
    free(b->grid.tiles);
}

/* Whether the block has a crossed cell, and which cells. */
static bool look(const grid_view *view, const int32_t block[3], uint8_t rows[64])
{
    float f[8][GRID_VIEW_VOXELS];
    bool leaf = false, inside = false, outside = false, any = false;
    memset(rows, 0, 64);
    for (int k = 0; k < 8; k++) {
        const grid_view_block near =
            grid_view_find(view, block[0] + (k >> 2), block[1] + (k >> 1 & 1), block[2] + (k & 1));
        leaf |= near.leaf != BLOCK_MAP_NONE;
        inside |= near.constant < 0;
        outside |= !(near.constant < 0);
        grid_view_read(view, near, f[k]);
    }
    if (!leaf && !(inside && outside)) return false;
    for (int cell = 0; cell < GRID_VIEW_VOXELS; cell++) {
        int below = 0;
        for (int k = 0; k < 8; k++) {
            const int x = (cell >> 6) + (k >> 2), y = (cell >> 3 & 7) + (k >> 1 & 1),
                      z = (cell & 7) + (k & 1);
            below += f[(x >> 3) << 2 | (y >> 3) << 1 | z >> 3][(x & 7) << 6 | (y & 7) << 3 | (z & 7)] < 0;
        }
        if (below == 0 || below == 8) continue;
        rows[cell >> 3] |= (uint8_t)(1u << (cell & 7));
        any = true;
    }
    return any;
}

/* The merged results of several threads equal those of one thread. */
static void reach_by_threads(const crossings *found, threads *pool)
{
    const reach_limits limits = {.straight = 4};
    error e = {0};
    block_map one = {0}, several = {0};
    assert_true(block_map_init(&one, 0, &e) && block_map_init(&several, 0, &e));
    assert_true(reach_add_blocks(found, limits, NULL, &one, &e));
    assert_true(reach_add_blocks(found, limits, pool, &several, &e));
    assert_true(found->count > 10000 && one.count > found->count); /* enough that each thread has a part */
    assert_int_equal(one.count, several.count);
    assert_memory_equal(one.blocks, several.blocks, one.count * sizeof *one.blocks);
    block_map_free(&one);
    block_map_free(&several);
}

static void hold_against_all_cells(float background, uint64_t seed, threads *pool)
{
    error e = {0};
    grid_view view;
    crossings found = {0};
    builder b = make(background, seed);
    size_t n = 0, without_leaf = 0;
    assert_true(grid_view_init(&view, &b.grid, GRID_VIEW_LEVEL_SET, 0, SIZE_MAX, pool, &e));
    assert_true(crossings_find(&view, SIZE_MAX, pool, &found, &e));
    for (int k = 0; k < (ALL + 2) * (ALL + 2) * (ALL + 2); k++) { /* in the order of the coordinates */
        const int32_t block[3] = {FIRST - 1 + k / ((ALL + 2) * (ALL + 2)),
                                  FIRST - 1 + k / (ALL + 2) % (ALL + 2), FIRST - 1 + k % (ALL + 2)};
        uint8_t rows[64];
        if (!look(&view, block, rows)) continue;
        assert_true(n < found.count);
        assert_memory_equal(found.blocks[n].block, block, sizeof block);
        assert_memory_equal(found.blocks[n].rows, rows, sizeof rows);
        without_leaf += grid_view_find(&view, block[0], block[1], block[2]).leaf == BLOCK_MAP_NONE;
        n++;
    }
    assert_int_equal(n, found.count);
    assert_true(without_leaf > 1000);
    reach_by_threads(&found, pool);
    crossings_free(&found);
    grid_view_free(&view);
    release(&b);
}

static void crossed_cells_are_those_of_all_cells(void **state)
{
    (void)state;
    const uint64_t seed = test_seed();
    error e = {0};
    threads *pool = threads_new(3, NULL, &e);
    assert_non_null(pool);
    hold_against_all_cells(3, seed, NULL);
    hold_against_all_cells(-3, seed + 1, pool);
    threads_free(pool);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(crossed_cells_are_those_of_all_cells)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
