// SPDX-License-Identifier: Apache-2.0
/* Progressive order: every point is nearly the farthest from the points before it, by a computation over
 * all pairs. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "base/core/rng.h"
#include "sampling/measures/progressive_order.h"
#include "sampling/packing/point_flags.h"
#include "shapes.h"

enum { MOST = 900, SIDES = 3 };
/* As sites.h has it; written out, since the test shares no code with the order. */
static const double OPPOSITE = -0.4, BATCH = 0.98;

typedef struct cloud {
    size_t count, copies;
    vec3 position[MOST], normal[2 * MOST];
    double spacing[MOST];
    uint32_t piece[MOST], copy_point[2 * MOST];
    uint8_t flags[2 * MOST];
    vec3 side[MOST][SIDES]; /* the normals of each point */
    int sides[MOST];
    bool one_sided[MOST];
} cloud;

static void add(cloud *c, vec3 x, vec3 n, double h, uint32_t piece)
{
    const size_t i = c->count++;
    c->position[i] = x;
    c->normal[i] = n;
    c->spacing[i] = h;
    c->piece[i] = piece;
    c->side[i][c->sides[i]++] = n;
}

/* Further copies follow all points. */
static void add_copy(cloud *c, size_t point, vec3 normal)
{
    if (c->copies < c->count) {
        for (size_t i = 0; i < c->count; i++) c->copy_point[i] = (uint32_t)i;
        c->copies = c->count;
    }
    c->copy_point[c->copies] = (uint32_t)point;
    c->normal[c->copies++] = normal;
    c->side[point][c->sides[point]++] = normal;
}

static void find(const cloud *c, uint32_t *order)
{
    error e = {0};
    const progressive_order_input in = {.count = c->count,
                                        .position = c->position,
                                        .spacing = c->spacing,
                                        .piece = c->piece,
                                        .copy_count = c->copies ? c->copies : c->count,
                                        .copy_normal = c->normal,
                                        .copy_point = c->copies ? c->copy_point : NULL,
                                        .copy_flags = c->flags};
    if (!progressive_order(&in, NULL, order, &e)) fail_msg("%s", e.message);
}

/* ---- computation over all pairs */

/* Whether the points belong to one component and have normals that are not opposite. */
static bool are_near(const cloud *c, size_t i, size_t j)
{
    bool alike = false;
    for (int a = 0; a < c->sides[i]; a++)
        for (int b = 0; b < c->sides[j]; b++) {
            const double cosine = vec3_dot(c->side[i][a], c->side[j][b]);
            alike |= (c->one_sided[i] || c->one_sided[j] ? fabs(cosine) : cosine) > OPPOSITE;
        }
    return alike && c->piece[i] == c->piece[j];
}

static double distance(const cloud *c, size_t i, size_t j)
{
    const double far =
        vec3_norm(vec3_sub(c->position[i], c->position[j])) / (0.5 * (c->spacing[i] + c->spacing[j]));
    return are_near(c, i, j) ? far : PROGRESSIVE_ORDER_APART * far;
}

/* Each point comes once, and its distance from the points before it is at least BATCH times the largest of
 * the rest. */
static void check(const cloud *c)
{
    static uint32_t order[MOST];
    static double far[MOST];
    static bool taken[MOST];
    find(c, order);
    memset(taken, 0, sizeof taken);
    for (size_t i = 0; i < c->count; i++) far[i] = INFINITY;
    for (size_t k = 0; k < c->count; k++) {
        const uint32_t next = order[k];
        double farthest = 0;
        assert_true(next < c->count && !taken[next]);
        for (size_t i = 0; i < c->count; i++)
            if (!taken[i]) farthest = fmax(farthest, far[i]);
        if (k == 0) assert_int_equal(next, 0);
        if (k > 0 && far[next] < farthest * BATCH * (1 - 1e-12))
            fail_msg("point %zu is at %.15g, and another at %.15g", k, far[next], farthest);
        taken[next] = true;
        for (size_t i = 0; i < c->count; i++)
            if (!taken[i]) far[i] = fmin(far[i], distance(c, i, next));
    }
}

/* ---- tests */

static void each_point_of_a_sphere_is_the_farthest(void **state)
{
    (void)state;
    static cloud c;
    rng r = rng_seed(test_seed(), 0);
    memset(&c, 0, sizeof c);
    for (int i = 0; i < MOST; i++) {
        const vec3 n = random_direction(&r);
        add(&c, n, n, 0.1, 0);
    }
    check(&c);
}

static void graded_spacings_count_by_their_mean(void **state)
{
    (void)state;
    static cloud c;
    rng r = rng_seed(test_seed(), 1);
    memset(&c, 0, sizeof c);
    for (int i = 0; i < 600; i++) {
        const vec3 n = random_direction(&r);
        add(&c, n, n, exp(2 * n.x), 0);
    }
    check(&c);
}

/* Two walls, two components, points on creases, coincident points, and a one-sided surface. */
static void walls_pieces_and_creases_are_treated_as_by_the_measures(void **state)
{
    (void)state;
    static cloud c;
    rng r = rng_seed(test_seed(), 2);
    memset(&c, 0, sizeof c);
    for (int i = 0; i < 300; i++) {
        const double up = i % 2 ? 1 : -1;
        add(&c, vec3_make(rng_uniform(&r), rng_uniform(&r), 0.01 * up), vec3_make(0, 0, up), 0.1,
            (uint32_t)(i % 3 == 0));
    }
    for (int i = 0; i < 20; i++) add(&c, c.position[i], c.normal[i], 0.1, c.piece[i]);
    const size_t one_sided = c.count;
    for (int i = 0; i < 40; i++)
        add(&c, vec3_make(3 + rng_uniform(&r), rng_uniform(&r), 0), vec3_make(0, 0, i % 2 ? 1 : -1), 0.1, 2);
    for (size_t i = one_sided; i < c.count; i++) {
        c.flags[i] = PACKING_ONE_SIDED;
        c.one_sided[i] = true;
    }
    for (size_t i = 0; i < 60; i += 3) add_copy(&c, i, vec3_make(1, 0, 0));
    for (size_t i = 1; i < 60; i += 6) add_copy(&c, i, vec3_make(0, 0, -c.normal[i].z));
    check(&c);
}

static void few_points_are_ordered_too(void **state)
{
    (void)state;
    static cloud c;
    rng r = rng_seed(test_seed(), 3);
    for (size_t count = 1; count < 40; count++) {
        memset(&c, 0, sizeof c);
        for (size_t i = 0; i < count; i++) {
            const vec3 n = random_direction(&r);
            add(&c, n, n, 1, 0);
        }
        check(&c);
    }
}

/* In every prefix the walls of a plate much thinner than the spacing have nearly equal numbers of points, and
 * neither wall has a hole. */
static void a_prefix_covers_both_walls_of_a_thin_plate(void **state)
{
    (void)state;
    static cloud c;
    static uint32_t order[MOST];
    memset(&c, 0, sizeof c);
    for (int wall = 0; wall < 2; wall++)
        for (int i = 0; i < 20; i++)
            for (int k = 0; k < 20; k++)
                add(&c, vec3_make(i + 0.5 * (k % 2), sqrt(0.75) * k, 1e-3 * wall),
                    vec3_make(0, 0, wall ? 1 : -1), 1, 0);
    find(&c, order);
    for (size_t n = 32; n <= c.count / 2; n += 24) {
        size_t above = 0;
        double farthest = 0;
        for (size_t k = 0; k < n; k++) above += order[k] >= c.count / 2;
        assert_in_range(above, n / 3, 2 * n / 3);
        for (size_t i = 0; i < c.count; i++) {
            double nearest = INFINITY;
            for (size_t k = 0; k < n; k++)
                if (are_near(&c, i, order[k]))
                    nearest = fmin(nearest, vec3_norm(vec3_sub(c.position[i], c.position[order[k]])));
            farthest = fmax(farthest, nearest);
        }
        if (farthest > 1.3 * sqrt((double)c.count / (double)n))
            fail_msg("%zu points leave a hole of %g", n, farthest);
    }
}

static void the_pool_stops_it(void **state)
{
    (void)state;
    static cloud c;
    static uint32_t order[MOST];
    volatile sig_atomic_t stop = 1;
    error e = {0};
    memset(&c, 0, sizeof c);
    for (int i = 0; i < 100; i++) add(&c, vec3_make(i, 0, 0), vec3_make(0, 0, 1), 1, 0);
    threads *pool = threads_new(1, &stop, &e);
    const progressive_order_input in = {.count = c.count,
                                        .position = c.position,
                                        .spacing = c.spacing,
                                        .copy_count = c.count,
                                        .copy_normal = c.normal};
    assert_false(progressive_order(&in, pool, order, &e));
    assert_int_equal(e.code, ERROR_CANCELLED);
    threads_free(pool);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_point_of_a_sphere_is_the_farthest),
        cmocka_unit_test(graded_spacings_count_by_their_mean),
        cmocka_unit_test(walls_pieces_and_creases_are_treated_as_by_the_measures),
        cmocka_unit_test(few_points_are_ordered_too),
        cmocka_unit_test(a_prefix_covers_both_walls_of_a_thin_plate),
        cmocka_unit_test(the_pool_stops_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
