/* Who is near a place, by bins and by a tree, against looking at all. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "shapes.h"
#include "geometry/moving_points.h"
#include "geometry/near_points.h"
#include "geometry/point_bins.h"
#include "geometry/point_tree.h"

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
        point_bins *bins = point_bins_new(x, count, NULL, &e);
        for (int p = 0; p < PLACES; p++) {
            vec3 place = vec3_scale(random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1}), 4);
            double least = INFINITY, found, enough = 3 * rng_uniform(&r);
            for (size_t k = 0; k < count; k++) least = fmin(least, vec3_norm(vec3_sub(x[k], place)));
            uint32_t point = point_tree_nearest(n, place, 0, &found);
            assert_true(found == least && vec3_norm(vec3_sub(x[point], place)) == found);
            point = point_tree_nearest(n, place, enough, &found);
            assert_true(found == least || found <= enough);
            assert_true(vec3_norm(vec3_sub(x[point], place)) == found);
            if (p % 2) place = vec3_scale(place, 0.25);
            least = INFINITY;
            for (size_t k = 0; k < count; k++) least = fmin(least, vec3_norm(vec3_sub(x[k], place)));
            point = point_bins_nearest(bins, place, 0, &found);
            assert_true(found == least && vec3_norm(vec3_sub(x[point], place)) == found);
            point = point_bins_nearest(bins, place, enough, &found);
            assert_true(found == least || found <= enough);
            assert_true(vec3_norm(vec3_sub(x[point], place)) == found);
        }
        point_tree_free(n);
        point_bins_free(bins);
    }
    free(x);
}

/* Some move about, or all; the nearest is told among those where they are. */
static void the_nearest_is_found_while_some_move(void **state)
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
        moving_points *m = moving_points_new(x, COUNT, moving, some, NULL, &e);
        for (int p = 0; p < PLACES; p++) {
            const uint32_t except = moving[(size_t)p % some];
            const vec3 place = random_between(&r, (vec3){-2, -2, -2}, (vec3){2, 2, 2});
            double least2 = INFINITY;
            x[moving[(size_t)(p / 2) % some]] = place; /* at times the one that does not count */
            for (uint32_t i = 0; i < COUNT; i++)
                if (i != except) least2 = fmin(least2, vec3_norm2(vec3_sub(x[i], place)));
            assert_true(moving_points_nearest2(m, place, except) == least2);
        }
        moving_points_free(m);
    }
    const vec3 alone = {0, 0, 0};
    const uint32_t first = 0;
    error e = {0};
    moving_points *m = moving_points_new(&alone, 1, &first, 1, NULL, &e);
    assert_true(moving_points_nearest2(m, alone, 0) == INFINITY);
    moving_points_free(m);
}

/* Counts each point, and those that are farther than they may be. */
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
    point_bins *bins = point_bins_new(x, POINTS, NULL, &e);
    point_tree *tree = point_tree_new(x, POINTS, &e);
    near_points *either = near_points_new(x, POINTS, NULL, &e);
    for (size_t p = 0; p < PLACES; p++) {
        visits v = {x, random_between(&r, (vec3){-2, -2, -2}, (vec3){2, 2, 2}), 1, seen};
        if (p % 2) v.place = x[p]; /* and some of the others are just as far away as they may be */
        v.reach = p % 4 == 3 ? vec3_norm(vec3_sub(x[p], x[p + 1])) : rng_uniform(&r);
        for (int way = 0; way < 3; way++) {
            memset(seen, 0, POINTS * sizeof *seen);
            if (way == 0) point_bins_within(bins, v.place, v.reach, count_visit, &v);
            if (way == 1) point_tree_within(tree, v.place, v.reach, count_visit, &v);
            if (way == 2) near_points_within(either, v.place, v.reach, count_visit, &v);
            for (size_t k = 0; k < POINTS; k++)
                assert_int_equal(seen[k], vec3_norm2(vec3_sub(x[k], v.place)) <= v.reach * v.reach);
        }
    }
    point_bins_free(bins);
    point_tree_free(tree);
    near_points_free(either);
    free(x);
    free(seen);
}

/* Points in two heaps far from each other share bins, those of a plane do not. Either way the nearest is
 * found. */
static void crowds_are_told(void **state)
{
    (void)state;
    enum { SIDE = 64, POINTS = SIDE * SIDE };
    vec3 *x = malloc(POINTS * sizeof *x);
    error e = {0};
    for (int heaps = 0; heaps < 2; heaps++) {
        for (size_t k = 0; k < POINTS; k++) {
            x[k] = (vec3){k % SIDE, (double)(k / SIDE), 0};
            if (heaps) x[k] = vec3_add(x[k], vec3_scale((vec3){1, 1, 1}, k % 2 ? 10000 : 0));
        }
        point_bins *bins = point_bins_new(x, POINTS, NULL, &e);
        assert_true(point_bins_are_dense(bins) == heaps);
        point_bins_free(bins);
        near_points *near = near_points_new(x, POINTS, NULL, &e);
        for (size_t k = 0; k < POINTS; k += 7) {
            double distance;
            const vec3 place = vec3_add(x[k], (vec3){0.25, -0.25, 0.5});
            assert_int_equal(near_points_nearest(near, place, 0, &distance), k);
            assert_true(distance == vec3_norm(vec3_sub(x[k], place)));
        }
        near_points_free(near);
    }
    free(x);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_nearest_is_found),
        cmocka_unit_test(the_nearest_is_found_while_some_move),
        cmocka_unit_test(all_within_reach_are_visited_once),
        cmocka_unit_test(crowds_are_told),
    };
    return cmocka_run_group_tests_name("near_points", tests, NULL, NULL);
}
