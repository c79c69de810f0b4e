// SPDX-License-Identifier: Apache-2.0
/* crossed_cells: each cell is returned with its place, its block and F at its corners, for any set of
 * cells. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include <string.h>

#include "samples_fixture.h"
#include "shapes.h"
#include "surface/volume/crossed_cells.h"

enum { SIDE = 4, BLOCKS = SIDE * SIDE * SIDE, LATE = 3 };

/* Every third block has cells: one in `rarity`, and always the one at a corner. */
static crossings random_crossings(const block_map *map, uint64_t rarity, rng *r)
{
    crossings c = {0};
    c.blocks = calloc(BLOCKS, sizeof *c.blocks);
    for (uint32_t n = 0; n < map->count; n += 3) {
        crossing_block *b = &c.blocks[c.count++];
        memcpy(b->block, map->blocks[n], sizeof b->block);
        for (int k = 0; k < GRID_VIEW_VOXELS; k++)
            if (rng_uniform(r) * (double)rarity < 1) b->rows[k >> 3] |= (uint8_t)(1 << (k & 7));
        if (n % 2)
            b->rows[63] |= 0x80;
        else
            b->rows[0] |= 1;
        for (int row = 0; row < 64; row++) c.cells += (unsigned)__builtin_popcount(b->rows[row]);
    }
    return c;
}

static void check_cells(const crossed_cells *made, const samples *s, const crossings *c)
{
    size_t k = 0;
    for (size_t i = 0; i < c->count; i++) {
        float corners[729];
        samples_corners(s, c->blocks[i].block, false, corners);
        for (int bit = 0; bit < GRID_VIEW_VOXELS; bit++) {
            const int at[3] = {bit >> 6, bit >> 3 & 7, bit & 7};
            crossed_cell got;
            if (!(c->blocks[i].rows[bit >> 3] >> at[2] & 1)) continue;
            int32_t place[3];
            crossed_cells_place(made, k, place);
            crossed_cells_get(made, k++, &got);
            assert_memory_equal(place, got.at, sizeof place);
            assert_int_equal(got.block, block_map_find(made->map, c->blocks[i].block[0],
                                                       c->blocks[i].block[1], c->blocks[i].block[2]));
            for (int axis = 0; axis < 3; axis++)
                assert_int_equal(got.at[axis], 8 * c->blocks[i].block[axis] + at[axis]);
            for (int corner = 0; corner < 8; corner++)
                assert_true(got.value[corner] ==
                            corners[81 * (at[0] + (corner & 1)) + 9 * (at[1] + (corner >> 1 & 1)) + at[2] +
                                    (corner >> 2)]);
        }
    }
    assert_int_equal(k, crossed_cells_in_blocks(made));
}

static void stored_cells_are_read_back_unchanged(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    error e = {0};
    threads *pool = threads_new(3, NULL, &e);
    assert_non_null(pool);
    const uint64_t rarities[] = {1, 2, 8, 60, 100000};
    for (size_t k = 0; k < sizeof rarities / sizeof *rarities; k++) {
        samples s = samples_fixture(SIDE, -2, false, &r);
        crossings c = random_crossings(&s.map, rarities[k], &r);
        crossed_cells made;
        assert_true(crossed_cells_list(&c, &s.map, k % 2 ? pool : NULL, &made, &e));
        assert_int_equal(made.count, c.cells);
        const size_t values = made.blocks[made.block_count].values;
        assert_true(values >= c.cells && values <= 729 * c.count);
        assert_true(crossed_cells_take_values(&made, &s, false, k % 2 ? pool : NULL, &e));
        check_cells(&made, &s, &c);
        crossed_cell *late = calloc(LATE, sizeof *late);
        for (int i = 0; i < LATE; i++) late[i].at[0] = i + 1;
        crossed_cells_add_late(&made, late, LATE);
        check_cells(&made, &s, &c);
        assert_int_equal(made.count, c.cells + LATE);
        for (size_t i = 0; i < LATE; i++) {
            crossed_cell got;
            int32_t place[3];
            crossed_cells_get(&made, c.cells + i, &got);
            assert_int_equal(got.at[0], i + 1);
            crossed_cells_place(&made, c.cells + i, place);
            assert_memory_equal(place, got.at, sizeof place);
        }
        crossed_cells_free(&made);
        crossings_free(&c);
        samples_free(&s);
    }
    threads_free(pool);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(stored_cells_are_read_back_unchanged),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
