// SPDX-License-Identifier: Apache-2.0
/* Counts of crossings of lines through volumes of known shape. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "surface/volume/thin_walls.h"

enum { SIZE = 48 };

/* F of a wall of a thickness in voxels around the plane of a normal through `at` voxels along it. */
typedef struct wall {
    double normal[3], at, thickness;
} wall;

static double wall_value(const wall *w, int x, int y, int z)
{
    return fabs(w->normal[0] * x + w->normal[1] * y + w->normal[2] * z - w->at) - 0.5 * w->thickness;
}

/* A paraboloid that ends just above its isovalue: a smooth minimum without a wall. */
static double bowl_value(const wall *w, int x, int y, int z)
{
    const double u = x - 23.6, v = y - 24.3, t = z - 23.5;
    return u * u + v * v + t * t + w->thickness;
}

static thin_walls_found search(double (*value)(const wall *, int, int, int), const wall *w)
{
    static double slice[SIZE * SIZE];
    error e = {0};
    thin_walls_search *s = thin_walls_begin(SIZE, SIZE, &e);
    assert_non_null(s);
    for (int z = 0; z < SIZE; z++) {
        for (int k = 0; k < SIZE * SIZE; k++) slice[k] = -value(w, k % SIZE, k / SIZE, z);
        thin_walls_add(s, slice, 0, NAN);
    }
    const thin_walls_found found = thin_walls_take(s);
    thin_walls_end(s);
    return found;
}

static void wall_between_samples_is_lost_on_every_line_across(void **state)
{
    (void)state;
    for (int axis = 0; axis < 3; axis++) {
        wall w = {.at = 20.5, .thickness = 0.5};
        w.normal[axis] = 1;
        thin_walls_found found = search(wall_value, &w);
        assert_int_equal(found.crossed, 0);
        assert_int_equal(found.kinks, SIZE * SIZE);
        for (size_t k = 0; k < thin_walls_kept(&found); k++) {
            assert_int_equal(found.kink[k].axis, axis);
            assert_int_equal(found.kink[k].at[axis], 20);
        }
        thin_walls_free(&found);
    }
}

static void oblique_wall_is_lost_on_the_share_of_lines_between_samples(void **state)
{
    (void)state;
    const wall w = {{0.408248, 0.577350, 0.707107}, 40, 0.3};
    thin_walls_found found = search(wall_value, &w);
    const double lost = 2 * (double)found.kinks, all = lost + (double)found.crossed;
    /* a line at the cosine c has the share 0.3 / c with a sample; its weight is c */
    const double expected = 1 - 3 * 0.3 / (w.normal[0] + w.normal[1] + w.normal[2]);
    assert_true(fabs(lost / all - expected) < 0.03);
    thin_walls_free(&found);
}

static void thick_wall_and_smooth_minimum_lose_nothing(void **state)
{
    (void)state;
    const wall walls[] = {{{0.6, 0.64, 0.48}, 40, 3}, {{0, 0, 1}, 20.2, 1.1}};
    for (int k = 0; k < 2; k++) {
        thin_walls_found found = search(wall_value, &walls[k]);
        assert_true(found.crossed > 0);
        assert_int_equal(found.kinks, 0);
        thin_walls_free(&found);
    }
    const wall near = {.thickness = 0.01};
    thin_walls_found found = search(bowl_value, &near);
    assert_int_equal(found.kinks, 0);
    thin_walls_free(&found);
}

static void wall_with_one_sample_is_thin(void **state)
{
    (void)state;
    const wall thin = {{0, 1, 0}, 20.1, 0.8}, thick = {{0, 1, 0}, 20.1, 2.4};
    thin_walls_found found = search(wall_value, &thin);
    assert_int_equal(found.thin, found.crossed);
    thin_walls_free(&found);
    found = search(wall_value, &thick);
    assert_int_equal(found.thin, 0);
    thin_walls_free(&found);
}

static void many_kinks_are_a_sample_of_all(void **state)
{
    (void)state;
    enum { WIDE = 300, DEEP = 6 };
    static double slice[WIDE * WIDE];
    static bool seen[WIDE][WIDE];
    error e = {0};
    thin_walls_search *s = thin_walls_begin(WIDE, WIDE, &e);
    assert_non_null(s);
    for (int z = 0; z < DEEP; z++) {
        for (int k = 0; k < WIDE * WIDE; k++) slice[k] = -fabs(z - 2.5) + 0.25;
        thin_walls_add(s, slice, 0, NAN);
    }
    thin_walls_found found = thin_walls_take(s);
    thin_walls_end(s);
    assert_int_equal(found.kinks, WIDE * WIDE);
    assert_int_equal(thin_walls_kept(&found), THIN_WALLS_KEPT);
    int left = 0, upper = 0;
    for (size_t k = 0; k < THIN_WALLS_KEPT; k++) {
        const thin_walls_edge *edge = &found.kink[k];
        assert_int_equal(edge->axis, 2);
        assert_false(seen[edge->at[0]][edge->at[1]]);
        seen[edge->at[0]][edge->at[1]] = true;
        left += edge->at[0] < WIDE / 2;
        upper += edge->at[1] < WIDE / 2;
    }
    assert_true(abs(2 * left - THIN_WALLS_KEPT) < THIN_WALLS_KEPT / 100);
    assert_true(abs(2 * upper - THIN_WALLS_KEPT) < THIN_WALLS_KEPT / 100);
    thin_walls_free(&found);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(wall_between_samples_is_lost_on_every_line_across),
        cmocka_unit_test(oblique_wall_is_lost_on_the_share_of_lines_between_samples),
        cmocka_unit_test(thick_wall_and_smooth_minimum_lose_nothing),
        cmocka_unit_test(wall_with_one_sample_is_thin),
        cmocka_unit_test(many_kinks_are_a_sample_of_all),
    };
    return cmocka_run_group_tests_name("thin_walls", tests, NULL, NULL);
}
