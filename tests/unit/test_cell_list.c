// SPDX-License-Identifier: Apache-2.0
/* Searches of a cell list return the same as a comparison with all points. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "shapes.h"
#include "geometry/space/cell_list.h"

static void the_nearest_is_found(void **state)
{
    (void)state;
    enum { MOST = 3000, PLACES = 300 };
    rng r = rng_seed(test_seed(), 0);
    static const size_t counts[] = {1, 2, 8, 9, 17, 100, MOST};
    vec3 *x = malloc(MOST * sizeof *x);
    for (size_t c = 0; c < 3 * sizeof counts / sizeof counts[0]; c++) {
        size_t count = counts[c / 3];
        for (size_t k = 0; k < count; k++) {
            x[k] = random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1});
            if (c % 3 == 1) x[k] = (vec3){floor(3 * x[k].x), floor(3 * x[k].y), 0}; /* many are equal */
            if (c % 3 == 2) x[k] = (vec3){(double)k, 0, 0};                         /* sorted */
        }
        error e = {0};
        cell_list *n = cell_list_new(x, count, NULL, &e);
        for (int p = 0; p < PLACES; p++) {
            const vec3 place =
                vec3_scale(random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1}), p % 2 ? 1 : 4);
            double least = INFINITY, found, enough = 3 * rng_uniform(&r);
            for (size_t k = 0; k < count; k++) least = fmin(least, vec3_norm(vec3_sub(x[k], place)));
            uint32_t point = cell_list_nearest(n, place, 0, &found);
            assert_true(found == least && vec3_norm(vec3_sub(x[point], place)) == found);
            point = cell_list_nearest(n, place, enough, &found);
            assert_true(found == least || found <= enough);
            assert_true(vec3_norm(vec3_sub(x[point], place)) == found);
        }
        cell_list_free(n);
    }
    free(x);
}

/* Some or all points move; a search uses their current positions. */
static void the_nearest_is_found_while_points_move(void **state)
{
    (void)state;
    enum { COUNT = 400, PLACES = 100 };
    rng r = rng_seed(test_seed(), 3);
    for (uint32_t every = 1; every <= COUNT; every *= 3) {
        vec3 x[COUNT];
        uint32_t moving[COUNT];
        size_t some = 0;
        error e = {0};
        for (uint32_t i = 0; i < COUNT; i++) {
            x[i] = random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1});
            if (i % every == every / 2) moving[some++] = i;
        }
        moving_cell_list *m = moving_cell_list_new(x, COUNT, moving, some, NULL, &e);
        for (int p = 0; p < PLACES; p++) {
            const uint32_t except = moving[(size_t)p % some];
            const vec3 place = random_between(&r, (vec3){-2, -2, -2}, (vec3){2, 2, 2});
            double least2 = INFINITY;
            x[moving[(size_t)(p / 2) % some]] = place; /* sometimes the excluded point */
            for (uint32_t i = 0; i < COUNT; i++)
                if (i != except) least2 = fmin(least2, vec3_norm2(vec3_sub(x[i], place)));
            assert_true(moving_cell_list_nearest2(m, place, except) == least2);
        }
        moving_cell_list_free(m);
    }
    const vec3 alone = {0, 0, 0};
    const uint32_t first = 0;
    error e = {0};
    moving_cell_list *m = moving_cell_list_new(&alone, 1, &first, 1, NULL, &e);
    assert_true(moving_cell_list_nearest2(m, alone, 0) == INFINITY);
    moving_cell_list_free(m);
}

/* Counts the visits of each point; fails for a point beyond the reach. */
typedef struct visits {
    const vec3 *x;
    vec3 place;
    double reach;
    int *seen;
} visits;

static void count_visit(void *context, uint32_t point)
{
    const visits *v = context;
    v->seen[point]++;
    assert_true(vec3_norm2(vec3_sub(v->x[point], v->place)) <= v->reach * v->reach);
}

static void all_within_reach_are_visited_once(void **state)
{
    (void)state;
    enum { POINTS = 500, PLACES = 200 };
    rng r = rng_seed(test_seed(), 2);
    vec3 *x = malloc(POINTS * sizeof *x);
    int *seen = malloc(POINTS * sizeof *seen);
    error e = {0};
    for (size_t k = 0; k < POINTS; k++) {
        x[k] = random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1});
        if (k % 3 == 0) x[k] = (vec3){floor(5 * x[k].x) / 5, floor(5 * x[k].y) / 5, 0};
    }
    cell_list *n = cell_list_new(x, POINTS, NULL, &e);
    for (size_t p = 0; p < PLACES; p++) {
        visits v = {x, random_between(&r, (vec3){-2, -2, -2}, (vec3){2, 2, 2}), 1, seen};
        if (p % 2) v.place = x[p]; /* some points lie exactly at the reach */
        v.reach = p % 4 == 3 ? vec3_norm(vec3_sub(x[p], x[p + 1])) : rng_uniform(&r);
        memset(seen, 0, POINTS * sizeof *seen);
        cell_list_within(n, v.place, v.reach, count_visit, &v);
        for (size_t k = 0; k < POINTS; k++)
            assert_int_equal(seen[k], vec3_norm2(vec3_sub(x[k], v.place)) <= v.reach * v.reach);
    }
    cell_list_free(n);
    free(x);
    free(seen);
}

/* Points of two distant clusters share cells; points of a plane do not. The nearest point is found in both
 * cases. */
static void over_dense_points_are_detected(void **state)
{
    (void)state;
    enum { SIDE = 64, POINTS = SIDE * SIDE };
    vec3 *x = malloc(POINTS * sizeof *x);
    error e = {0};
    for (int clusters = 0; clusters < 2; clusters++) {
        for (size_t k = 0; k < POINTS; k++) {
            x[k] = (vec3){k % SIDE, (double)(k / SIDE), 0};
            if (clusters) x[k] = vec3_add(x[k], vec3_scale((vec3){1, 1, 1}, k % 2 ? 10000 : 0));
        }
        cell_list *n = cell_list_new(x, POINTS, NULL, &e);
        assert_true(cell_list_is_dense(n) == clusters);
        for (size_t k = 0; k < POINTS; k += 7) {
            double distance;
            const vec3 place = vec3_add(x[k], (vec3){0.25, -0.25, 0.5});
            assert_int_equal(cell_list_nearest(n, place, 0, &distance), k);
            assert_true(distance == vec3_norm(vec3_sub(x[k], place)));
            int seen[POINTS] = {0};
            visits v = {x, x[k], 1, seen};
            cell_list_within(n, x[k], 1, count_visit, &v);
            for (size_t i = 0; i < POINTS; i++)
                assert_int_equal(seen[i], vec3_norm2(vec3_sub(x[i], x[k])) <= 1);
        }
        cell_list_free(n);
    }
    free(x);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_nearest_is_found),
        cmocka_unit_test(the_nearest_is_found_while_points_move),
        cmocka_unit_test(all_within_reach_are_visited_once),
        cmocka_unit_test(over_dense_points_are_detected),
    };
    return cmocka_run_group_tests_name("cell_list", tests, NULL, NULL);
}
