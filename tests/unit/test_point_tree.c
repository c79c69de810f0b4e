// SPDX-License-Identifier: Apache-2.0
/* Searches of a tree of points return the same as a comparison with all points. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "shapes.h"
#include "geometry/space/point_tree.h"

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
        point_tree *n = point_tree_new(x, count, &e);
        for (int p = 0; p < PLACES; p++) {
            const vec3 place = vec3_scale(random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1}), 4);
            double least = INFINITY, found, enough = 3 * rng_uniform(&r);
            for (size_t k = 0; k < count; k++) least = fmin(least, vec3_norm(vec3_sub(x[k], place)));
            uint32_t point = point_tree_nearest(n, place, 0, &found);
            assert_true(found == least && vec3_norm(vec3_sub(x[point], place)) == found);
            point = point_tree_nearest(n, place, enough, &found);
            assert_true(found == least || found <= enough);
            assert_true(vec3_norm(vec3_sub(x[point], place)) == found);
        }
        point_tree_free(n);
    }
    free(x);
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
    point_tree *n = point_tree_new(x, POINTS, &e);
    for (size_t p = 0; p < PLACES; p++) {
        visits v = {x, random_between(&r, (vec3){-2, -2, -2}, (vec3){2, 2, 2}), 1, seen};
        if (p % 2) v.place = x[p]; /* some points lie exactly at the reach */
        v.reach = p % 4 == 3 ? vec3_norm(vec3_sub(x[p], x[p + 1])) : rng_uniform(&r);
        memset(seen, 0, POINTS * sizeof *seen);
        point_tree_within(n, v.place, v.reach, count_visit, &v);
        for (size_t k = 0; k < POINTS; k++)
            assert_int_equal(seen[k], vec3_norm2(vec3_sub(x[k], v.place)) <= v.reach * v.reach);
    }
    point_tree_free(n);
    free(x);
    free(seen);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_nearest_is_found),
        cmocka_unit_test(all_within_reach_are_visited_once),
    };
    return cmocka_run_group_tests_name("point_tree", tests, NULL, NULL);
}
