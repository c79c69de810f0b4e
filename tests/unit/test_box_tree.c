// SPDX-License-Identifier: Apache-2.0
/* Walks over a tree of boxes find the same boxes as a test of all boxes, whatever their sizes. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "geometry/space/box_tree.h"
#include "shapes.h"

enum { COUNT = 4000, PLACES = 500 };

static bbox box[COUNT];
static size_t counts[] = {0, 1, 2, 4, 5, 9, 1024, COUNT};
enum { COUNTS = sizeof counts / sizeof *counts };

static vec3 random_place(rng *r)
{
    return random_between(r, (vec3){-3, -2, 0}, (vec3){3, 2, 1});
}

/* A length from 1e-4 to 1. */
static double random_length(rng *r)
{
    return pow(10, 4 * (rng_uniform(r) - 1));
}

static bbox box_at(const void *context, uint32_t item)
{
    return ((const bbox *)context)[item];
}

static box_tree random_tree(rng *r, size_t count)
{
    static vec3 centre[COUNT];
    box_tree t;
    error e = {0};
    for (size_t k = 0; k < count; k++) {
        box[k].min = random_place(r);
        box[k].max = vec3_add(
            box[k].min, vec3_scale(random_between(r, (vec3){0, 0, 0}, (vec3){1, 1, 1}), random_length(r)));
        centre[k] = vec3_scale(vec3_add(box[k].min, box[k].max), 0.5);
    }
    assert_true(box_tree_make(count, centre, box_at, box, NULL, "test", &t, &e));
    assert_int_equal(t.count, count);
    return t;
}

/* Marks the items of the current leaf. Each item is found once. */
static void mark(const box_tree *t, const box_tree_walk *w, bool *found)
{
    assert_true(w->end <= t->count);
    for (size_t k = w->first; k < w->end; k++) {
        assert_false(found[t->order[k]]);
        found[t->order[k]] = true;
    }
}

static void check_meeting(const box_tree *t, rng *r)
{
    for (int p = 0; p < PLACES; p++) {
        static bool found[COUNT];
        const vec3 x = random_place(r);
        const bbox where = bbox_grow((bbox){x, x}, random_length(r));
        box_tree_walk w;
        memset(found, 0, sizeof found);
        box_tree_begin(t, &w);
        while (box_tree_next_meeting(t, &w, &where)) mark(t, &w, found);
        for (size_t k = 0; k < t->count; k++) assert_true(found[k] || !bbox_meet(&box[k], &where));
    }
}

static void boxes_that_meet_a_box_are_found(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    for (size_t n = 0; n < COUNTS; n++) {
        box_tree t = random_tree(&r, counts[n]);
        check_meeting(&t, &r);
        for (size_t k = 0; k < t.count; k += 7) { /* half of the positions are far away, half in the box */
            const uint32_t item = t.order[k];
            const vec3 x = k % 2 ? random_place(&r) : box[item].max;
            box_tree_extend(&t, k, x);
            box[item] = bbox_include(box[item], x);
        }
        check_meeting(&t, &r);
        box_tree_free(&t);
    }
}

static void the_nearest_box_is_found(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    for (size_t n = 0; n < COUNTS; n++) {
        box_tree t = random_tree(&r, counts[n]);
        size_t visited = 0;
        for (int p = 0; p < PLACES; p++) {
            const vec3 x = vec3_scale(random_place(&r), p % 2 ? 1 : 3);
            double least = INFINITY, found = INFINITY;
            box_tree_walk w;
            for (size_t k = 0; k < t.count; k++) least = fmin(least, box_tree_distance2(&box[k], x));
            box_tree_begin_near(&t, &w, x);
            while (box_tree_next_near(&t, &w, found))
                for (size_t k = w.first; k < w.end; k++, visited++)
                    found = fmin(found, box_tree_distance2(&box[t.order[k]], x));
            assert_true(found == least);
        }
        assert_true(t.count < COUNT || visited < PLACES * t.count / 10); /* few boxes are visited */
        box_tree_free(&t);
    }
}

static void boxes_that_a_line_crosses_are_found(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 2);
    static bool found[COUNT];
    for (size_t n = 0; n < COUNTS; n++) {
        box_tree t = random_tree(&r, counts[n]);
        for (int p = 0; p < PLACES; p++) {
            const vec3 x = random_place(&r), to = random_place(&r),
                       d = p % 3 ? vec3_sub(to, x) : (vec3){p % 2, (p + 1) % 2, 0};
            box_tree_walk w;
            memset(found, 0, sizeof found);
            box_tree_begin(&t, &w);
            while (box_tree_next_crossed(&t, &w, x, d)) mark(&t, &w, found);
            for (size_t k = 0; k < t.count; k++) {
                const vec3 in = {fmin(fmax(to.x, box[k].min.x), box[k].max.x),
                                 fmin(fmax(to.y, box[k].min.y), box[k].max.y),
                                 fmin(fmax(to.z, box[k].min.z), box[k].max.z)};
                /* a line to one of its points */
                assert_true(box_tree_is_crossed(&box[k], x, vec3_sub(in, x)));
                assert_true(found[k] || !box_tree_is_crossed(&box[k], x, d));
            }
        }
        box_tree_free(&t);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(boxes_that_meet_a_box_are_found),
        cmocka_unit_test(the_nearest_box_is_found),
        cmocka_unit_test(boxes_that_a_line_crosses_are_found),
    };
    return cmocka_run_group_tests_name("box_tree", tests, NULL, NULL);
}
