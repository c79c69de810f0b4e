// SPDX-License-Identifier: Apache-2.0
/* Distances of the surface from points: gaps of known size, and the nearest of random points against all
 * points. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "base/core/rng.h"
#include "close.h"
#include "geometry/space/packing.h"
#include "shapes.h"
#include "sampling/solver/particles/coverage.h"

/* Points on a sphere in a spiral whose turns are one spacing apart, without those within `bald` of the
 * pole. */
static size_t spiral(size_t count, double bald, vec3 *out)
{
    size_t kept = 0;
    for (size_t k = 0; k < count; k++) {
        double z = 1 - (2 * (double)k + 1) / (double)count, across = sqrt(1 - z * z),
               turn = M_PI * (3 - sqrt(5)) * (double)k;
        if (acos(z) > bald) out[kept++] = (vec3){across * cos(turn), across * sin(turn), z};
    }
    return kept;
}

static double farthest(const analytic_params *shape, const vec3 *position, size_t count, double h,
                       int workers)
{
    error e = {0};
    double *spacing = malloc(count * sizeof *spacing), found = 0;
    threads *pool = threads_new(workers, NULL, &e);
    analytic *a = analytic_new(shape, pool, &e);
    surface *scan = surface_scan(&a->base, pool, &e);
    for (size_t k = 0; k < count; k++) spacing[k] = h;
    assert_true(coverage_measure(scan, position, spacing, count, pool, &found, &e));
    surface_free(scan);
    analytic_free(a);
    threads_free(pool);
    free(spacing);
    return found;
}

/* The pole is the place farthest from a surrounding ring of points. */
static void the_largest_gap_has_its_radius(void **state)
{
    (void)state;
    enum { COUNT = 2000 };
    const analytic_params ball = {.shape = ANALYTIC_SPHERE, .radius = 1};
    vec3 *x = malloc(COUNT * sizeof *x);
    double h = packing_spacing(4 * M_PI, COUNT), whole = farthest(&ball, x, spiral(COUNT, 0, x), h, 1);
    assert_true(whole > 0.57 && whole < 0.9);
    for (int k = 2; k <= 20; k *= 2) {
        double bald = k * h;
        size_t count = spiral(COUNT, bald, x);
        double found = farthest(&ball, x, count, h, 1);
        assert_true(found > 2 * sin(bald / 2) / h - 0.2 && found < 2 * sin(bald / 2) / h + 0.9);
        assert_true(found == farthest(&ball, x, count, h, 3));
    }
    free(x);
}

/* Distances are in the requested spacing of the nearest point. */
static void distances_are_in_spacings(void **state)
{
    (void)state;
    const analytic_params ball = {.shape = ANALYTIC_SPHERE, .radius = 1};
    const vec3 poles[2] = {{0, 0, 1}, {0, 0, -1}};
    error e = {0};
    threads *pool = threads_new(1, NULL, &e);
    analytic *a = analytic_new(&ball, pool, &e);
    surface *scan = surface_scan(&a->base, pool, &e);
    const double even[2] = {1, 1}, uneven[2] = {1, 0.5};
    double found = 0;
    assert_true(coverage_measure(scan, poles, even, 2, pool, &found, &e));
    assert_close(found, sqrt(2), 0.01);
    double more = 2;
    assert_true(coverage_measure(scan, poles, even, 2, pool, &more, &e));
    assert_true(more == 2);
    assert_true(coverage_measure(scan, poles, uneven, 2, pool, &found, &e));
    assert_close(found, 2 * sqrt(2), 0.02);
    surface_free(scan);
    analytic_free(a);
    threads_free(pool);
}

/* Spacings that differ by a factor of 10 across a seam. The search is skipped by the smallest spacing around
 * a place. */
static void a_gap_is_found_beside_fine_points(void **state)
{
    (void)state;
    enum { COARSE = 2000, FINE = 100 * COARSE };
    const analytic_params ball = {.shape = ANALYTIC_SPHERE, .radius = 1};
    const double h = packing_spacing(4 * M_PI, COARSE);
    vec3 *x = malloc((COARSE + FINE) * sizeof *x);
    double *spacing = malloc((COARSE + FINE) * sizeof *spacing);
    for (int k = 8; k <= 12; k += 4) { /* more than the width of the seam, in fine spacings */
        const double bald = k * h;
        double found[2] = {0, 0};
        size_t count = 0, some = spiral(COARSE, bald, x);
        for (size_t i = 0; i < some; i++)
            if (x[i].z > 0) x[count++] = x[i];
        for (size_t i = 0; i < count; i++) spacing[i] = h;
        some = spiral(FINE, 0, x + count);
        for (size_t i = count, end = count + some; i < end; i++) {
            if (x[i].z > 0) continue;
            spacing[count] = h / 10;
            x[count++] = x[i];
        }
        for (int workers = 1; workers <= 3; workers += 2) {
            error e = {0};
            threads *pool = threads_new(workers, NULL, &e);
            analytic *a = analytic_new(&ball, pool, &e);
            surface *scan = surface_scan(&a->base, pool, &e);
            assert_true(coverage_measure(scan, x, spacing, count, pool, &found[workers / 2], &e));
            surface_free(scan);
            analytic_free(a);
            threads_free(pool);
        }
        assert_true(found[0] > 2 * sin(bald / 2) / h - 0.2 && found[0] < 2 * sin(bald / 2) / h + 0.9);
        assert_true(found[0] == found[1]);
    }
    free(x);
    free(spacing);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_largest_gap_has_its_radius),
        cmocka_unit_test(distances_are_in_spacings),
        cmocka_unit_test(a_gap_is_found_beside_fine_points),
    };
    return cmocka_run_group_tests_name("coverage", tests, NULL, NULL);
}
