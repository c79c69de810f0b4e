/* crossed_cells: whether each cell comes back with its place, its block and F at its corners, whatever cells there are. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <cmocka.h>

#include <string.h>

#include "base/memory.h"
#include "volume/crossed_cells.h"

enum { SIDE = 4, BLOCKS = SIDE * SIDE * SIDE, LATE = 3 };

static uint64_t next(uint64_t *seed)
{
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return *seed >> 33;
}

/* Blocks of random voxels. */
static samples random_samples(uint64_t *seed)
{
    samples s = {0};
    error e = {0};
    assert_true(block_map_init(&s.map, 0, &e));
    for (int k = 0; k < BLOCKS; k++)
        assert_true(block_map_find_or_add(&s.map, k / (SIDE * SIDE) - 2, k / SIDE % SIDE - 2, k % SIDE - 2,
                                          NULL, &e));
    s.f = mem_array(BLOCKS, sizeof *s.f, "voxels", &e);
    s.others.f = mem_array(BLOCKS, GRID_VIEW_VOXELS * sizeof *s.others.f, "voxels", &e);
    assert_true(s.f && s.others.f);
    for (size_t k = 0; k < BLOCKS; k++) s.f[k] = s.others.f + k * GRID_VIEW_VOXELS;
    for (size_t k = 0; k < (size_t)BLOCKS * GRID_VIEW_VOXELS; k++) s.others.f[k] = (float)next(seed);
    return s;
}

/* Every third block has cells: one in `rarity`, and always the one at a corner. */
static crossings random_crossings(const block_map *map, uint64_t rarity, uint64_t *seed)
{
    crossings c = {0};
    c.blocks = calloc(BLOCKS, sizeof *c.blocks);
    for (uint32_t n = 0; n < map->count; n += 3) {
        crossing_block *b = &c.blocks[c.count++];
        memcpy(b->block, map->blocks[n], sizeof b->block);
        for (int k = 0; k < GRID_VIEW_VOXELS; k++)
            if (next(seed) % rarity == 0) b->rows[k >> 3] |= (uint8_t)(1 << (k & 7));
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
            crossed_cells_get(made, k++, &got);
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
    assert_int_equal(k, made->in_blocks);
}

static void cells_come_back_as_they_are(void **state)
{
    (void)state;
    const char *given = getenv("HEXAD_TEST_SEED");
    uint64_t seed = given ? strtoull(given, NULL, 0) : 18;
    error e = {0};
    printf("# seed %llu\n", (unsigned long long)seed);
    threads *pool = threads_new(3, NULL, &e);
    assert_non_null(pool);
    const uint64_t rarities[] = {1, 2, 8, 60, 100000};
    for (size_t k = 0; k < sizeof rarities / sizeof *rarities; k++) {
        samples s = random_samples(&seed);
        crossings c = random_crossings(&s.map, rarities[k], &seed);
        crossed_cells made;
        assert_true(crossed_cells_list(&c, &s.map, k % 2 ? pool : NULL, &made, &e));
        assert_int_equal(made.count, c.cells);
        assert_true(made.value_count >= c.cells && made.value_count <= 729 * c.count);
        assert_true(crossed_cells_take_values(&made, &s, false, k % 2 ? pool : NULL, &e));
        check_cells(&made, &s, &c);
        crossed_cell *late = calloc(LATE, sizeof *late);
        for (int i = 0; i < LATE; i++) late[i].at[0] = i + 1;
        crossed_cells_add_late(&made, late, LATE);
        check_cells(&made, &s, &c);
        assert_int_equal(made.count, c.cells + LATE);
        for (size_t i = 0; i < LATE; i++) {
            crossed_cell got;
            crossed_cells_get(&made, made.in_blocks + i, &got);
            assert_int_equal(got.at[0], i + 1);
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
        cmocka_unit_test(cells_come_back_as_they_are),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
