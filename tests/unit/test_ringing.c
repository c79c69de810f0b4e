// SPDX-License-Identifier: Apache-2.0
/* Jumps beside flat surfaces: which cells ring, which samples are limited, and when the surface is the jump itself. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "samples_fixture.h"
#include "surface/volume/prefilter.h"
#include "surface/volume/ringing.h"

enum { BLOCKS = 3, SIDE = GRID_VIEW_SIDE, ALL = BLOCKS * SIDE };

/* F at a voxel. */
typedef struct shape {
    double (*value)(const struct shape *, int x, int y, int z);
    double at, jump; /* the place along the normal of a jump, and F beyond it */
} shape;

/* The distance from an oblique plane through the middle. */
static double oblique(const shape *s, int x, int y, int z)
{
    const double along = (x + y + z - 1.5 * (ALL - 1)) / sqrt(3);
    return along > s->at ? s->jump : along;
}

/* A slab with faces on both sides of the middle, as distances. */
static double slab(const shape *s, int x, int y, int z)
{
    (void)y;
    (void)z;
    return fabs(x - 0.5 * (ALL - 1)) - s->at;
}

/* Smoke: a ramp of two voxels between the plateaus `jump` and `jump` - 1. */
static double smoke(const shape *s, int x, int y, int z)
{
    return s->jump - fmin(fmax(0.5 - 0.5 * slab(s, x, y, z), 0), 1);
}

static samples samples_of(const shape *s)
{
    error e = {0};
    rng unused = rng_seed(1, 0);
    samples made = samples_fixture(BLOCKS, 0, false, &unused);
    made.known = mem_array(made.map.count * SIDE, sizeof *made.known, "voxels", &e);
    made.near = mem_array(made.map.count * 6, sizeof *made.near, "voxels", &e);
    assert_true(made.known && made.near);
    memset(made.known, 0xff, made.map.count * SIDE * sizeof *made.known);
    for (size_t n = 0; n < made.map.count; n++) {
        const int32_t *b = made.map.blocks[n];
        for (int k = 0; k < GRID_VIEW_VOXELS; k++)
            made.f[n][k] =
                (float)s->value(s, SIDE * b[0] + k / 64, SIDE * b[1] + k / 8 % 8, SIDE * b[2] + k % 8);
        for (int k = 0; k < 6; k++) {
            int32_t at[3] = {b[0], b[1], b[2]};
            at[k / 2] += k % 2 ? 1 : -1;
            made.near[6 * n + (size_t)k] = block_map_find(&made.map, at[0], at[1], at[2]);
        }
    }
    return made;
}

/* Which cells are listed: those with samples of both signs, or the others within two voxels of the jump. */
typedef enum listed { CROSSED, BESIDE_JUMP } listed;

/* A list without cells in blocks; free it with crossed_cells_free. */
static crossed_cells cells_of(const shape *s, const block_map *map, listed which)
{
    crossed_cells made = {.map = map, .blocks = calloc(1, sizeof *made.blocks)};
    crossed_cell *cell = calloc(ALL * ALL * ALL, sizeof *cell);
    size_t count = 0;
    assert_true(made.blocks && cell);
    for (int k = 0; k < ALL * ALL * ALL; k++) {
        crossed_cell c = {.at = {k / (ALL * ALL), k / ALL % ALL, k % ALL}};
        int inside = 0;
        bool beside = false;
        if (c.at[0] == ALL - 1 || c.at[1] == ALL - 1 || c.at[2] == ALL - 1) continue;
        c.block = block_map_find(map, c.at[0] >> 3, c.at[1] >> 3, c.at[2] >> 3);
        for (int i = 0; i < 8; i++) {
            c.value[i] = (float)s->value(s, c.at[0] + (i & 1), c.at[1] + (i >> 1 & 1), c.at[2] + (i >> 2));
            inside += c.value[i] < 0;
            beside |= (double)c.value[i] < s->at && (double)c.value[i] > s->at - 2;
        }
        const bool crossed = inside > 0 && inside < 8;
        if (which == CROSSED ? crossed : !crossed && beside) cell[count++] = c;
    }
    crossed_cells_add_late(&made, cell, count);
    return made;
}

/* The share of cells beside a jump that ring. */
static double share_of(const shape *s, int workers, bool *certain)
{
    error e = {0};
    samples made = samples_of(s);
    block_map map;
    coefficient_blocks b;
    threads *pool = threads_new(workers, NULL, &e);
    assert_true(pool && block_map_copy(&made.map, &map, &e));
    assert_true(prefilter_run(&made, false, pool, &e));
    assert_true(coefficient_blocks_build(&made, &map, 0, pool, &b, &e));
    crossed_cells cells = cells_of(s, &map, BESIDE_JUMP);
    assert_true(cells.count > 1000);
    const double share = ringing_share(&b, &cells, pool, certain);
    crossed_cells_free(&cells);
    coefficient_blocks_free(&b);
    block_map_free(&map);
    threads_free(pool);
    return share;
}

static void cells_beside_a_jump_ring(void **state)
{
    (void)state;
    for (int workers = 1; workers <= 3; workers++) {
        bool certain;
        const shape far = {oblique, 4, 9999}, none = {oblique, 4, 4}, small = {oblique, 4, 120};
        const double share = share_of(&far, workers, &certain);
        assert_true(share > 0.1 && certain);
        assert_true(share == share_of(&far, 1, &certain));
        assert_true(share_of(&none, workers, &certain) == 0 && !certain);
        assert_true(share_of(&small, workers, &certain) > 0 && !certain);
    }
}

/* Limits the samples; the caller frees all three. */
static void limit(const shape *s, samples *made, crossed_cells *cells, ringing_limits *out)
{
    error e = {0};
    *made = samples_of(s);
    *cells = cells_of(s, &made->map, CROSSED);
    *out = (ringing_limits){0};
    assert_true(cells->count > 100 && ringing_limit(cells, made, out, &e));
}

static void samples_beyond_a_jump_are_limited(void **state)
{
    (void)state;
    const shape s = {oblique, 3, 9999};
    samples made;
    crossed_cells cells;
    ringing_limits limits;
    float largest = 0;
    uint64_t beyond = 0;
    limit(&s, &made, &cells, &limits);
    for (size_t n = 0; n < made.map.count; n++)
        for (int k = 0; k < GRID_VIEW_VOXELS; k++) largest = fmaxf(largest, made.f[n][k]);
    for (int k = 0; k < ALL * ALL * ALL; k++)
        beyond += fabs(s.value(&s, k / (ALL * ALL), k / ALL % ALL, k % ALL)) > (double)(2 * largest);
    assert_true(largest > 1.3F && largest < 3);
    assert_non_null(limits.limited);
    assert_int_equal(limits.count, beyond);
    assert_true((double)limits.was ==
                (double)(float)s.value(&s, limits.first[0], limits.first[1], limits.first[2]));
    assert_true(fabsf(limits.was) > 2 * largest);
    const int32_t beside[3] = {14, 13, 13}, middle[3] = {11, 11, 11};
    assert_true(ringing_is_limited(&limits, &made.map, beside));
    assert_false(ringing_is_limited(&limits, &made.map, middle));
    ringing_free(&limits);
    crossed_cells_free(&cells);
    samples_free(&made);
}

static void surface_in_the_jump_is_not_limited(void **state)
{
    (void)state;
    const shape s = {oblique, 0.4, 9999};
    samples made, before = samples_of(&s);
    crossed_cells cells;
    ringing_limits limits;
    limit(&s, &made, &cells, &limits);
    assert_null(limits.limited);
    assert_int_equal(limits.count, 0);
    for (size_t n = 0; n < made.map.count; n++)
        assert_memory_equal(made.f[n], before.f[n], GRID_VIEW_VOXELS * sizeof *made.f[n]);
    crossed_cells_free(&cells);
    samples_free(&before);
    samples_free(&made);
}

/* The share of the first cells of a shape that are one-sided. */
static double one_sided(const shape *s, size_t count)
{
    error e = {0};
    samples made = samples_of(s);
    block_map map;
    coefficient_blocks b;
    assert_true(block_map_copy(&made.map, &map, &e));
    assert_true(prefilter_run(&made, false, NULL, &e));
    assert_true(coefficient_blocks_build(&made, &map, 0, NULL, &b, &e));
    crossed_cells cells = cells_of(s, &map, CROSSED);
    assert_true(cells.count >= count);
    cells.count = count;
    const double share = ringing_one_sided(&b, &cells);
    crossed_cells_free(&cells);
    coefficient_blocks_free(&b);
    block_map_free(&map);
    return share;
}

static void surface_where_a_ramp_ends_is_one_sided(void **state)
{
    (void)state;
    /* the samples on both sides of a face: -0.398 and 0.002; -0.02 and 0.98 */
    const shape ramp = {smoke, 5.3, 0.002}, distances = {slab, 5.52, 0};
    assert_true(one_sided(&ramp, 1000) > 0.9);
    assert_true(one_sided(&ramp, 900) == 0);
    assert_true(one_sided(&distances, 1000) == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cells_beside_a_jump_ring),
        cmocka_unit_test(samples_beyond_a_jump_are_limited),
        cmocka_unit_test(surface_in_the_jump_is_not_limited),
        cmocka_unit_test(surface_where_a_ramp_ends_is_one_sided),
    };
    return cmocka_run_group_tests_name("ringing", tests, NULL, NULL);
}
