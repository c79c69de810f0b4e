// SPDX-License-Identifier: Apache-2.0
/* Registration of surfaces with known motions, and its derivatives against finite differences. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "surface/field/projection.h"
#include "sampling/solver/registration.h"
#include "shapes.h"
#include "surface/scan/surface.h"

enum { POINTS = 3000 };

static const analytic_params ellipsoid = {
    .shape = ANALYTIC_ELLIPSOID, .center = {1, 2, 3}, .radii = {1, 0.7, 0.5}};
static const analytic_params ball = {.shape = ANALYTIC_SPHERE, .center = {1, 2, 3}, .radius = 0.8};

/* Random points on a surface. */
static void scatter(const analytic_params *shape, vec3 out[POINTS])
{
    error e = {0};
    analytic *a = analytic_new(shape, NULL, &e);
    threads *pool = threads_new(1, NULL, &e);
    surface *scan = a && pool ? surface_scan(&a->base, pool, &e) : NULL;
    if (!scan) fail_msg("%s", e.message);
    rng r = rng_seed(test_seed(), 0);
    const projection_limits limits = {20, 1e-9, 1e-9, 1e-9};
    for (int k = 0; k < POINTS; k++) {
        vec3 normal;
        out[k] = surface_point(scan, scan->area_before, (k + 0.5) / POINTS * scan->area, &r, NULL);
        assert_true(projection_find(&a->base, &limits, &out[k], &normal));
    }
    surface_free(scan);
    threads_free(pool);
    analytic_free(a);
}

/* The motion that maps the points onto the shape. */
static registration find(const vec3 *x, const analytic_params *shape, int workers)
{
    error e = {0};
    analytic *a = analytic_new(shape, NULL, &e);
    threads *pool = threads_new(workers, NULL, &e);
    if (!a || !pool) fail_msg("%s", e.message);
    registration m = registration_find(&a->base, x, POINTS, 0.05, pool);
    threads_free(pool);
    analytic_free(a);
    return m;
}

static void expect_near(vec3 a, vec3 b, double tolerance)
{
    assert_close(a.x, b.x, tolerance);
    assert_close(a.y, b.y, tolerance);
    assert_close(a.z, b.z, tolerance);
}

static void test_derivatives_are_those_of_the_motion(void **state)
{
    (void)state;
    const double step = 1e-6;
    rng r = rng_seed(test_seed(), 0);
    for (int k = 0; k < 200; k++) {
        const vec3 low = {-1, -1, -1}, high = {1, 1, 1};
        registration m = {random_between(&r, low, high), random_between(&r, low, high),
                          random_between(&r, low, high), rng_uniform(&r) - 0.5};
        /* also with rotations so small that a series is used */
        m.rotation = vec3_scale(m.rotation, k % 3 == 0 ? 2 : k % 3 == 1 ? 1e-5 : 0);
        vec3 x = random_between(&r, low, high), along = vec3_unit(random_between(&r, low, high));
        double derived[REGISTRATION_UNKNOWNS];
        registration_derive(&m, x, along, derived);
        for (int i = 0; i < REGISTRATION_UNKNOWNS; i++) {
            double value[2];
            for (int side = 0; side < 2; side++) {
                registration moved = m;
                double by = side ? step : -step;
                if (i < 3)
                    vec3_set(&moved.translation, i, vec3_get(m.translation, i) + by);
                else if (i < 6)
                    vec3_set(&moved.rotation, i - 3, vec3_get(m.rotation, i - 3) + by);
                else
                    moved.growth += by;
                value[side] = vec3_dot(along, registration_apply(&moved, x));
            }
            assert_close(derived[i], (value[1] - value[0]) / (2 * step), 1e-8);
        }
    }
}

static void test_an_ellipsoid_that_moves_turns_and_grows_is_followed(void **state)
{
    (void)state;
    vec3 x[POINTS], moved[POINTS];
    scatter(&ellipsoid, x);
    /* the points are displaced by a known motion, whose inverse is expected */
    const registration away = {.centre = {1, 2, 3},
                               .translation = {0.1, -0.05, 0.08},
                               .rotation = {0.1, 0.15, -0.1},
                               .growth = -0.1};
    for (int k = 0; k < POINTS; k++) moved[k] = registration_apply(&away, x[k]);
    registration back = find(moved, &ellipsoid, 1);
    double worst = 0;
    for (int k = 0; k < POINTS; k++)
        worst = fmax(worst, vec3_norm(vec3_sub(registration_apply(&back, moved[k]), x[k])));
    /* a fifth of the spacing of 0.05, because the smallest motion is preferred */
    assert_close(worst, 0, 0.01);
    assert_close(back.growth, 0.1, 1e-3);
    assert_close(vec3_norm(back.rotation), vec3_norm(away.rotation), 0.01);
    registration same = find(moved, &ellipsoid, 3);
    assert_memory_equal(&back, &same, sizeof back);
}

static void test_a_sphere_does_not_spin(void **state)
{
    (void)state;
    vec3 x[POINTS];
    analytic_params moved = ball;
    scatter(&ball, x);
    moved.center = (vec3){1.1, 2, 2.9};
    moved.radius = 0.9;
    registration m = find(x, &moved, 1);
    expect_near(m.translation, (vec3){0.1, 0, -0.1}, 1e-3);
    expect_near(m.rotation, (vec3){0, 0, 0}, 1e-3);
    assert_close(exp(m.growth), 0.9 / 0.8, 1e-3);
}

static void test_vanished_parts_do_not_affect_the_motion(void **state)
{
    (void)state;
    vec3 x[POINTS];
    analytic_params moved = ellipsoid;
    scatter(&ellipsoid, x);
    for (int k = 0; k < POINTS / 10; k++)
        x[k] = (vec3){1 + 0.001 * k, 2, 3.9}; /* a bar that no longer exists */
    moved.center = (vec3){1.05, 2, 3};
    registration m = find(x, &moved, 1);
    vec3 pole = {1, 2, 3.5}; /* on the earlier surface */
    expect_near(registration_apply(&m, pole), vec3_add(pole, (vec3){0.05, 0, 0}), 0.01);
}

static void test_a_surface_at_rest_has_no_motion(void **state)
{
    (void)state;
    vec3 x[POINTS];
    scatter(&ellipsoid, x);
    registration m = find(x, &ellipsoid, 1);
    expect_near(m.translation, (vec3){0, 0, 0}, 1e-9);
    expect_near(m.rotation, (vec3){0, 0, 0}, 1e-9);
    expect_near(registration_apply(&m, x[7]), x[7], 1e-9);
    registration none =
        find(x, &(analytic_params){.shape = ANALYTIC_SPHERE, .center = {90, 90, 90}, .radius = 0.1}, 1);
    assert_true(isfinite(none.growth) && isfinite(none.rotation.x) && isfinite(none.translation.x));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_derivatives_are_those_of_the_motion),
        cmocka_unit_test(test_an_ellipsoid_that_moves_turns_and_grows_is_followed),
        cmocka_unit_test(test_a_sphere_does_not_spin),
        cmocka_unit_test(test_vanished_parts_do_not_affect_the_motion),
        cmocka_unit_test(test_a_surface_at_rest_has_no_motion),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
