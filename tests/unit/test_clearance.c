// SPDX-License-Identifier: Apache-2.0
/* The required spacing on shapes of known thickness. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "surface/field/analytic.h"
#include "sampling/sizing/clearance.h"

static clearance measure(const analytic_params *shape, double h, int workers)
{
    error e = {0};
    clearance c;
    threads *pool = threads_new(workers, NULL, &e);
    analytic *a = analytic_new(shape, pool, &e);
    surface *scan = surface_scan(&a->base, pool, &e);
    assert_true(clearance_measure(scan, NULL, h, pool, 0.02, &c, &e));
    surface_free(scan);
    analytic_free(a);
    threads_free(pool);
    return c;
}

/* A plate of thickness t is resolved with a spacing of t / 1.2, less the reserve. */
static void plates_need_their_thickness(void **state)
{
    (void)state;
    const analytic_params plate = {.shape = ANALYTIC_BOX, .half_size = {1, 1, 0.05}, .rounding = 0.04};
    clearance c = measure(&plate, 0.2, 2);
    assert_true(c.unresolved_share > 0.9);
    assert_in_range(1000 * c.factor * 0.2, 1000 * 0.6 * 0.1 / 1.2, 1000 * 0.1 / 1.2);
    c = measure(&plate, 0.05, 2);
    assert_true(c.unresolved_share == 0 && c.factor > 0.89);
}

/* Points at 114 degrees from each other on a tube of radius r face each other with a gap of 1.4 r. */
static void tubes_need_less_than_their_diameter(void **state)
{
    (void)state;
    const analytic_params tube = {
        .shape = ANALYTIC_TORUS, .axis = {0, 0, 1}, .major_radius = 1, .minor_radius = 0.1};
    clearance c = measure(&tube, 0.3, 2);
    assert_true(c.unresolved_share > 0.99);
    assert_in_range(1000 * c.factor * 0.3, 1000 * 0.8 * 0.14 / 1.2, 1000 * 1.05 * 0.14 / 1.2);
}

/* Beside its rim (63 degrees) and its tip (53 degrees) the walls of a solid cone are near at every spacing. */
static void edges_and_tips_are_not_thin_walls(void **state)
{
    (void)state;
    const analytic_params cone = {.shape = ANALYTIC_FRUSTUM, .axis = {0, 0, 1}, .core = {-1, 1, 1, 0}};
    for (double h = 0.05; h < 0.3; h *= 2) {
        const clearance c = measure(&cone, h, 2);
        if (!(c.unresolved_share < 0.02 && c.factor == 1))
            fail_msg("spacing %g: share %g, factor %g", h, c.unresolved_share, c.factor);
    }
}

/* A wedge of 20 degrees is thin beside its edge as well. */
static void sharp_wedges_are_thin(void **state)
{
    (void)state;
    const analytic_params cone = {.shape = ANALYTIC_FRUSTUM, .axis = {0, 0, 1}, .core = {0, 0.36, 1, 0}};
    assert_true(measure(&cone, 0.1, 2).unresolved_share > 0.3);
}

static void a_ball_needs_nothing(void **state)
{
    (void)state;
    const analytic_params ball = {.shape = ANALYTIC_SPHERE, .radius = 1};
    clearance c = measure(&ball, 0.1, 1), again = measure(&ball, 0.1, 3);
    assert_true(c.unresolved_share == 0 && c.factor == 1);
    assert_memory_equal(&c, &again, sizeof c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(plates_need_their_thickness), cmocka_unit_test(tubes_need_less_than_their_diameter),
        cmocka_unit_test(a_ball_needs_nothing),        cmocka_unit_test(edges_and_tips_are_not_thin_walls),
        cmocka_unit_test(sharp_wedges_are_thin),
    };
    return cmocka_run_group_tests_name("clearance", tests, NULL, NULL);
}
