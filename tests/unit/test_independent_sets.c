// SPDX-License-Identifier: Apache-2.0
/* Independent sets: every point is in one set, and no set contains two neighbours. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "close.h"
#include "sampling/packing/independent_sets.h"
#include "shapes.h"

enum { COUNT = 20000 };

typedef struct fixture {
    threads *pool;
    neighbours *near;
} fixture;

/* Points on a bumpy surface, partly over-dense, with sizes in a ratio of up to `widest` : 1. */
static void set_up(fixture *f, int thread_count, double widest)
{
    static vec3 x[COUNT];
    static double size[COUNT];
    error e = {0};
    rng r = rng_seed(test_seed(), 7);
    for (int i = 0; i < COUNT; i++) {
        x[i] = random_between(&r, (vec3){0, 0, 0}, (vec3){1, 1, 0.01});
        if (i % 10 == 0) x[i] = vec3_scale(x[i], 0.2);
        size[i] = 1 + (widest - 1) * x[i].x;
    }
    f->pool = threads_new(thread_count, NULL, &e);
    f->near = neighbours_new(COUNT, SIZE_MAX, &e);
    assert_true(neighbours_build(f->near, COUNT, x, size, 0.015, f->pool, &e));
    independent_sets_form(f->near, f->pool);
}

static void tear_down(fixture *f)
{
    neighbours_free(f->near);
    threads_free(f->pool);
}

static bool are_neighbours(const neighbours *n, uint32_t i, uint32_t j)
{
    for (uint32_t k = 0; k < n->list_count[i]; k++)
        if (neighbours_list(n, i)[k] == j) return true;
    return false;
}

static void check(double widest)
{
    fixture f;
    set_up(&f, 2, widest);
    int *seen = calloc(COUNT, sizeof *seen);
    size_t sets = 0;
    for (int c = 0; c < f.near->colours; c++)
        for (size_t group = 0; group < independent_sets_groups(f.near, c); group++) {
            uint32_t at, end, points[INDEPENDENT_SET_MOST];
            neighbours_block_points(f.near, independent_sets_group_begin(f.near, c, group),
                                    independent_sets_group_begin(f.near, c, group + 1), &at, &end);
            while (at < end) {
                uint32_t count = independent_sets_next(f.near, at, points);
                assert_in_range(count, 1, INDEPENDENT_SET_MOST);
                for (uint32_t a = 0; a < count; a++) {
                    seen[points[a]]++;
                    assert_int_equal(independent_sets_point(f.near, at + a), points[a]);
                    for (uint32_t b = 0; b < a; b++)
                        assert_false(are_neighbours(f.near, points[a], points[b]));
                }
                at += count;
                sets++;
            }
            assert_int_equal(at, end);
        }
    for (int i = 0; i < COUNT; i++) assert_int_equal(seen[i], 1);
    print_message("# sizes up to %g: %.1f points a set\n", widest, (double)COUNT / (double)sets);
    free(seen);
    tear_down(&f);
}

static void no_set_contains_two_neighbours(void **state)
{
    (void)state;
    check(1);
    check(5);
}

static void result_does_not_depend_on_threads(void **state)
{
    (void)state;
    fixture one, many;
    set_up(&one, 1, 2);
    set_up(&many, 4, 2);
    assert_memory_equal(one.near->bin_item, many.near->bin_item, COUNT * sizeof *one.near->bin_item);
    tear_down(&one);
    tear_down(&many);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_set_contains_two_neighbours),
        cmocka_unit_test(result_does_not_depend_on_threads),
    };
    return cmocka_run_group_tests_name("independent_sets", tests, NULL, NULL);
}
