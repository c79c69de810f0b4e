// SPDX-License-Identifier: Apache-2.0
/* Blocks are found by their coordinates, whatever the coordinates, while the map grows. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include <string.h>

#include "base/core/rng.h"
#include "geometry/space/block_map.h"
#include "shapes.h"

enum { COUNT = 20000, LOOKS = 100000 };

/* A block within `reach` of a corner of the range of coordinates, or of 0. */
static void random_block(rng *r, int corner, int64_t reach, int32_t out[3])
{
    for (int axis = 0; axis < 3; axis++) {
        const int64_t by = (int64_t)(rng_uniform(r) * (double)reach);
        out[axis] = (int32_t)(corner == 0 ? by - reach / 2 : corner == 1 ? INT32_MAX - by : INT32_MIN + by);
    }
}

static void check_map(rng *r, int corner, int64_t reach, size_t expected)
{
    error e = {0};
    block_map m;
    assert_true(block_map_init(&m, expected, &e));
    for (int k = 0; k < COUNT; k++) {
        int32_t b[3];
        uint32_t number;
        random_block(r, corner, reach, b);
        const uint32_t before = m.count, found = block_map_find(&m, b[0], b[1], b[2]);
        assert_true(block_map_find_or_add(&m, b[0], b[1], b[2], &number, &e));
        assert_int_equal(number, found == BLOCK_MAP_NONE ? before : found);
        assert_int_equal(m.count, before + (found == BLOCK_MAP_NONE));
        assert_memory_equal(m.blocks[number], b, sizeof b);
    }
    for (uint32_t n = 0; n < m.count; n++)
        assert_int_equal(block_map_find(&m, m.blocks[n][0], m.blocks[n][1], m.blocks[n][2]), n);
    block_map_seen seen = {0};
    for (int k = 0; k < LOOKS; k++) { /* missing blocks are not found, and existing ones are */
        int32_t b[3];
        random_block(r, corner, 2 * reach, b);
        const uint32_t n = block_map_find(&m, b[0], b[1], b[2]);
        if (n != BLOCK_MAP_NONE) assert_memory_equal(m.blocks[n], b, sizeof b);
        assert_int_equal(block_map_find_near(&m, b[0], b[1], b[2], &seen), n);
    }
    for (int k = 0; corner == 0 && k < LOOKS / 27; k++) {
        int32_t b[3];
        uint32_t around[27];
        random_block(r, corner, reach / 2, b);
        block_map_around(&m, b, around);
        for (int i = 0; i < 27; i++)
            assert_int_equal(around[i],
                             block_map_find(&m, b[0] + i / 9 - 1, b[1] + i / 3 % 3 - 1, b[2] + i % 3 - 1));
    }
    block_map copy; /* an independent copy */
    const uint32_t count = m.count;
    assert_true(block_map_copy(&m, &copy, &e));
    for (uint32_t k = 0; k < count; k++)
        assert_true(block_map_find_or_add(&copy, ~m.blocks[k][1], m.blocks[k][2], m.blocks[k][0], NULL, &e));
    for (uint32_t n = 0; n < count; n++)
        assert_int_equal(block_map_find(&copy, m.blocks[n][0], m.blocks[n][1], m.blocks[n][2]), n);
    assert_int_equal(m.count, count);
    block_map_free(&copy);
    block_map_free(&m);
}

static void blocks_are_found(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    const int64_t reaches[] = {3, 20, 60, 5000, INT32_MAX};
    for (size_t k = 0; k < sizeof reaches / sizeof *reaches; k++)
        for (int corner = 0; corner < 3; corner++) check_map(&r, corner, reaches[k], k % 2 ? COUNT : 0);
}

/* Each block has its own node, which needs the most memory. Earlier blocks are kept. */
static void scattered_blocks_keep_the_limit(void **state)
{
    (void)state;
    error e = {0};
    block_map m;
    int32_t k = 0;
    assert_true(block_map_init(&m, 0, &e));
    m.limit = 1 << 20;
    while (k < 1 << 20 && block_map_find_or_add(&m, 4 * k, 0, -4 * k, NULL, &e)) k++;
    assert_int_equal(e.code, ERROR_LIMIT_MEMORY);
    assert_int_equal(m.count, k);
    assert_true(k > 1000 && (size_t)k * sizeof *m.nodes <= 2 * m.limit);
    assert_int_equal(block_map_find(&m, 4, 0, -4), 1);
    assert_int_equal(block_map_find(&m, 4 * k, 0, -4 * k), BLOCK_MAP_NONE);
    block_map_free(&m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(blocks_are_found),
                                       cmocka_unit_test(scattered_blocks_keep_the_limit)};
    return cmocka_run_group_tests_name("block_map", tests, NULL, NULL);
}
