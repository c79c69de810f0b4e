// SPDX-License-Identifier: Apache-2.0
/* Coefficient blocks that are made at the first access equal those that are made in advance. Their flat cells
 * equal those that hidden_crossing finds for many cells at once.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "samples_fixture.h"
#include "shapes.h"
#include "surface/field/field.h"
#include "surface/volume/coefficient_block.h"
#include "surface/volume/hidden_crossing.h"

enum { BLOCKS = 5, LOOKS = 4000, WORKERS = 4 };

typedef struct looking {
    const coefficient_blocks *later, *once;
    bool stores_all; /* the coefficients of all blocks are stored */
    atomic_int wrong;
} looking;

/* Whether the coefficients of a cell of a coefficient block that is not stored are those of its
 * coefficient block. */
static bool cell_is(const coefficient_blocks *b, uint32_t n, size_t k, const float *coefficients)
{
    float buffer[COEFFICIENT_BLOCK_CELL];
    const int cell[3] = {(int)(k % 8), (int)(k / 8 % 8), (int)(k / 64 % 8)};
    const float *got = coefficient_blocks_find_cell(b, n, cell, buffer),
                *right = coefficient_block_cell(coefficients, cell[0], cell[1], cell[2]);
    bool same = true;
    for (int row = 0; row < 16; row++) {
        const int at = row / 4 * COEFFICIENT_BLOCK_SLAB + row % 4 * COEFFICIENT_BLOCK_SIDE;
        same &= memcmp(got + at, right + at, 4 * sizeof *got) == 0;
    }
    return same;
}

static void look_chunk(void *context, int worker, size_t begin, size_t end)
{
    looking *job = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        float buffer[COEFFICIENT_BLOCK_SIZE];
        const uint32_t n = (uint32_t)(k * 2654435761u % job->once->map->count);
        const float *coefficients = k % 3 ? coefficient_blocks_at(job->later, n)
                                          : coefficient_blocks_read_once(job->later, n, buffer),
                    *right = coefficient_blocks_at(job->once, n);
        const bool differs =
            coefficients ? memcmp(coefficients, right, COEFFICIENT_BLOCK_SIZE * sizeof *coefficients) != 0
                         : job->stores_all || !cell_is(job->later, n, k, right);
        if (differs) atomic_fetch_add(&job->wrong, 1);
    }
}

/* Stores at most a share of the blocks. */
static void check_blocks(size_t share)
{
    error e = {0};
    rng one = rng_seed(1, 0), other = rng_seed(1, 0);
    samples first = samples_fixture(BLOCKS, 0, true, &one), second = samples_fixture(BLOCKS, 0, true, &other);
    block_map map;
    coefficient_blocks once, later;
    threads *pool = threads_new(WORKERS, NULL, &e);
    assert_non_null(pool);
    assert_true(block_map_init(&map, 0, &e));
    for (uint32_t n = 0; n < first.map.count; n++) {
        const int32_t *at = first.map.blocks[n];
        assert_true(block_map_find_or_add(&map, at[0], at[1], at[2], NULL, &e));
    }
    const size_t share_count = map.count / share;
    assert_true(coefficient_blocks_build(&first, &map, 0, pool, &once, &e));
    assert_true(coefficient_blocks_build(&second, &map, share_count, pool, &later, &e));
    assert_null(first.f);
    assert_null(second.f);
    for (int round = 0; round < 3; round++) {
        looking job = {&later, &once, share == 1, 0};
        threads_run(pool, LOOKS, 8, look_chunk, &job);
        assert_int_equal(atomic_load(&job.wrong), 0);
        size_t there = 0;
        for (uint32_t n = 0; n < map.count; n++)
            there += atomic_load(&later.place[n]) >= COEFFICIENT_BLOCK_PRESENT;
        assert_int_equal(there, share_count);
        coefficient_blocks_discard(&later);
        coefficient_blocks_discard(&once);
        assert_int_equal(atomic_load(&later.place[map.count]), 0);
    }
    coefficient_blocks_free(&once);
    coefficient_blocks_free(&later);
    block_map_free(&map);
    threads_free(pool);
}

static void blocks_built_on_first_access_equal_those_built_at_once(void **state)
{
    (void)state;
    check_blocks(1);
    check_blocks(3);
    assert_int_equal(coefficient_blocks_capacity(1000, 10), 0);
    assert_int_equal(coefficient_blocks_capacity(1000000, 0), 0);
    assert_true(coefficient_blocks_capacity(1000000, 10) > 10 &&
                coefficient_blocks_capacity(1000000, 10) < 1000000);
    assert_int_equal(coefficient_blocks_capacity(1000000, 900000), 1000000);
}

/* Differences along at most two axes, so that rounding equals that of hidden_crossing.c. */
static float change(const float *c, const int at[3], int axis, int then)
{
    static const int step[3] = {COEFFICIENT_BLOCK_SLAB, COEFFICIENT_BLOCK_SIDE, 1};
    const float *p = coefficient_block_cell(c, at[0], at[1], at[2]);
    if (then < 0) return p[step[axis]] - p[0];
    return (p[step[axis] + step[then]] - p[step[then]]) - (p[step[axis]] - p[0]);
}

/* The bend of F in a cell, one difference at a time. */
static field_bend bend_of_cell(const float *first, double aspect)
{
    double slope2 = 0, bend = 0;
    for (int axis = 0; axis < 3; axis++) {
        double low = INFINITY, high = -INFINITY;
        for (int k = 0; k < 64; k++) {
            const int at[3] = {k >> 4, k >> 2 & 3, k & 3};
            if (at[axis] == 3) continue;
            low = fmin(low, (double)change(first, at, axis, -1));
            high = fmax(high, (double)change(first, at, axis, -1));
            for (int then = axis; then < 3; then++)
                if (at[then] < (then == axis ? 2 : 3))
                    bend = fmax(bend, fabs((double)change(first, at, axis, then)));
        }
        const double least = fmax(fmax(low, -high), 0);
        slope2 += least * least;
    }
    bend *= aspect;
    return bend * bend <= FIELD_FLAT_MOST * FIELD_FLAT_MOST * slope2       ? FIELD_FLAT
           : bend * bend <= FIELD_GENTLE_MOST * FIELD_GENTLE_MOST * slope2 ? FIELD_GENTLE
                                                                           : FIELD_BENT;
}

/* Blocks with a bent plane and local noise: cells that are nearly flat, or nearly not. Adds the numbers of
 * flat and of gentle cells. */
static void check_bends(rng *r, block_map *map, threads *pool, size_t *flat, size_t *gentle)
{
    float coefficients[COEFFICIENT_BLOCK_SIZE];
    uint8_t crossed[64];
    const coefficient_blocks b = {.map = map, .memory = coefficients, .capacity = 1};
    const double bend = 0.01 * rng_uniform(r), noise = 0.003 * rng_uniform(r), aspect = 1 + rng_uniform(r);
    const vec3 slope = {rng_uniform(r) - 0.5, rng_uniform(r) - 0.5, rng_uniform(r) - 0.5};
    const int wild = (int)(COEFFICIENT_BLOCK_SIZE * rng_uniform(r)); /* noise begins here */
    for (int k = 0; k < COEFFICIENT_BLOCK_SIZE; k++) {
        const vec3 p = {k / COEFFICIENT_BLOCK_SLAB, k / COEFFICIENT_BLOCK_SIDE % COEFFICIENT_BLOCK_SIDE,
                        k % COEFFICIENT_BLOCK_SIDE};
        coefficients[k] =
            (float)(vec3_dot(slope, p) + bend * p.x * (p.y - p.z) + (k > wild ? noise * rng_uniform(r) : 0));
    }
    for (int k = 0; k < 64; k++) crossed[k] = (uint8_t)(256 * rng_uniform(r) * rng_uniform(r));
    uint8_t asked[64];
    memcpy(asked, crossed, sizeof asked);
    error e = {0};
    hidden_crossing found = {0};
    field_bend bends[512];
    size_t cells = 0, bent = 0;
    for (int k = 0; k < 512; k++) {
        bends[k] = bend_of_cell(coefficient_block_cell(coefficients, k >> 6, k >> 3 & 7, k & 7), aspect);
        if (!(asked[k >> 3] >> (k & 7) & 1)) continue;
        cells++;
        bent += bends[k] == FIELD_BENT;
    }
    const bool is_gentle = 100 * bent <= cells; /* at most one cell in a hundred is bent */
    assert_true(hidden_crossing_find(&b, (const int64_t[]){0, 0, 0}, aspect, pool, crossed, &found, &e));
    for (int k = 0; k < 512; k++) {
        const bool is_asked = asked[k >> 3] >> (k & 7) & 1;
        assert_int_equal(found.flat[k >> 3] >> (k & 7) & 1, is_asked && bends[k] == FIELD_FLAT);
        assert_int_equal(found.gentle[k >> 3] >> (k & 7) & 1,
                         is_asked && is_gentle && bends[k] == FIELD_GENTLE);
        *flat += is_asked && bends[k] == FIELD_FLAT;
        *gentle += is_asked && is_gentle && bends[k] == FIELD_GENTLE;
    }
    hidden_crossing_free(&found);
}

static void cells_are_flat_one_by_one_or_together(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    error e = {0};
    block_map map;
    size_t flat = 0, gentle = 0;
    threads *pool = threads_new(1, NULL, &e);
    assert_true(pool && block_map_init(&map, 0, &e) && block_map_find_or_add(&map, 0, 0, 0, NULL, &e));
    for (int round = 0; round < 500; round++) check_bends(&r, &map, pool, &flat, &gentle);
    assert_in_range(flat, 500 * 512 / 100, 500 * 512 / 4 - 500 * 512 / 100); /* a fourth is requested */
    assert_true(gentle > 1000);
    block_map_free(&map);
    threads_free(pool);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(blocks_built_on_first_access_equal_those_built_at_once),
        cmocka_unit_test(cells_are_flat_one_by_one_or_together),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
