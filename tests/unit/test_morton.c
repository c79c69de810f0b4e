// SPDX-License-Identifier: Apache-2.0
/* Morton's order: a permutation sorted by the interleaved coordinates, along which neighbours are near. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "geometry/space/morton.h"
#include "shapes.h"

enum { SIDE = 16, COUNT = SIDE * SIDE * SIDE };

static void a_lattice_is_ordered_octant_by_octant(void **state)
{
    (void)state;
    static vec3 x[COUNT];
    static uint32_t order[COUNT];
    error e = {0};
    for (int k = 0; k < COUNT; k++) /* x slowest, so that the points are not sorted */
        x[k] = (vec3){k / (SIDE * SIDE), k / SIDE % SIDE, k % SIDE};
    assert_true(morton_order(x, COUNT, NULL, order, &e));
    bool seen[COUNT] = {false};
    for (int k = 0; k < COUNT; k++) {
        assert_false(seen[order[k]]);
        seen[order[k]] = true;
        /* the k-th octant of the lattice is the k-th eighth of the order, recursively */
        int expected[3] = {0, 0, 0};
        for (int bit = 0; bit < 12; bit++) expected[bit % 3] |= (k >> bit & 1) << bit / 3;
        assert_true(x[order[k]].x == expected[0] && x[order[k]].y == expected[1] &&
                    x[order[k]].z == expected[2]);
    }
}

static void coincident_points_keep_their_order(void **state)
{
    (void)state;
    vec3 x[5] = {{1, 2, 3}, {1, 2, 3}, {-1, 0, 0}, {1, 2, 3}, {-1, 0, 0}};
    uint32_t order[5];
    error e = {0};
    const uint32_t wanted[5] = {2, 4, 0, 1, 3};
    assert_true(morton_order(x, 5, NULL, order, &e));
    for (int k = 0; k < 5; k++) assert_int_equal(order[k], wanted[k]);
    assert_true(morton_order(x, 2, NULL, order, &e)); /* a box without extent */
    assert_true(order[0] == 0 && order[1] == 1);
}

/* There are enough points for several threads: each point occurs once, cells ascend, and points of a cell
 * keep their order. */
static void order_does_not_depend_on_threads(void **state)
{
    (void)state;
    enum { MANY = 100000 };
    error e = {0};
    vec3 *x = calloc(MANY, sizeof *x);
    uint32_t *order = calloc(MANY, sizeof *order), *other = calloc(MANY, sizeof *other);
    for (int k = 0; k < MANY; k++) x[k] = (vec3){k * 7919L % 1024, k * 104729L % 256, (double)(k % 3)};
    assert_true(morton_order(x, MANY, NULL, order, &e));
    for (int count = 2; count < 5; count++) {
        threads *pool = threads_new(count, NULL, &e);
        assert_true(morton_order(x, MANY, pool, other, &e));
        assert_memory_equal(order, other, MANY * sizeof *order);
        threads_free(pool);
    }
    bool *seen = calloc(MANY, sizeof *seen);
    for (int k = 0; k < MANY; k++) {
        assert_false(seen[order[k]]);
        seen[order[k]] = true;
        const vec3 a = x[order[k ? k - 1 : 0]], b = x[order[k]];
        const bool alike = a.x == b.x && a.y == b.y && a.z == b.z;
        if (k > 0 && alike) assert_true(order[k - 1] < order[k]);
        assert_true((int)a.x / 256 <=
                    /* the first two bits of a cell belong to x, since the box is four times as long in x */
                    (int)b.x / 256);
    }
    free(seen);
    free(x);
    free(order);
    free(other);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_lattice_is_ordered_octant_by_octant),
        cmocka_unit_test(coincident_points_keep_their_order),
        cmocka_unit_test(order_does_not_depend_on_threads),
    };
    return cmocka_run_group_tests_name("morton", tests, NULL, NULL);
}
