// SPDX-License-Identifier: Apache-2.0
/* Global control (6.1): particles are inserted and deleted until the bounds of their number and of the
 * support hold. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "sampling/solver/particles/population.h"
#include "sampling/solver/solver.h"
#include "shapes.h"

enum { QUARTIC = 4 };

/* Its packing of the quartic has about 480 points. */
#define SIGMA 0.18

/* ---- insertion and deletion */

static particles *row_of_particles(size_t count)
{
    particles *p = particles_new(count + 1, NULL);
    p->count = count;
    for (size_t i = 0; i < count; i++) {
        p->position[i] = (vec3){(double)i, 0, 0};
        p->normal[i] = (vec3){0, 0, 1};
        p->energy[i] = (float)(1 + 0.001 * (double)i);
        p->lambda[i] = (double)i;
    }
    return p;
}

static void growing_keeps_particles(void **state)
{
    (void)state;
    particles *p = row_of_particles(10);
    assert_true(particles_grow(p, 1000, NULL));
    assert_int_equal(p->count, 10);
    for (size_t i = 0; i < 10; i++) {
        assert_true(p->position[i].x == (double)i && p->lambda[i] == (double)i && p->alpha[i] == 1);
        assert_true(p->energy[i] == (float)(1 + 0.001 * (double)i));
    }
    p->position[999].x = 1; /* within the capacity */
    particles_free(p);
}

static void removal_keeps_the_order(void **state)
{
    (void)state;
    particles *p = row_of_particles(9);
    const bool marked[9] = {true, false, false, true, true, false, true, false, true};
    const double kept[] = {1, 2, 5, 7};
    assert_int_equal(population_remove(p, marked), 5);
    assert_int_equal(p->count, 4);
    for (size_t i = 0; i < 4; i++) assert_true(p->position[i].x == kept[i] && p->lambda[i] == kept[i]);
    particles_free(p);
}

/* Chooses 100 of 1000; their mean rank shows the bias. */
static void the_choice_follows_its_bias(void **state)
{
    (void)state;
    particles *p = row_of_particles(1000);
    double mean[3] = {0};
    for (int bias = POPULATION_RANDOM; bias <= POPULATION_LOW_ENERGY; bias++) {
        uint32_t chosen[100];
        rng r = rng_seed(test_seed(), 1);
        assert_true(population_choose(p, 100, (population_bias)bias, &r, chosen, NULL));
        for (size_t k = 0; k < 100; k++) {
            assert_true(chosen[k] < 1000 && (k == 0 || chosen[k] > chosen[k - 1]));
            mean[bias] += chosen[k] / 100.0;
        }
    }
    assert_close(mean[POPULATION_RANDOM], 500, 120); /* four standard deviations of the mean */
    assert_true(mean[POPULATION_HIGH_ENERGY] > 620 && mean[POPULATION_LOW_ENERGY] < 380);
    particles_free(p);
}

static void all_particles_can_be_chosen(void **state)
{
    (void)state;
    particles *p = row_of_particles(50);
    uint32_t chosen[50];
    rng r = rng_seed(1, 1);
    for (size_t i = 0; i < 50; i++) p->energy[i] = 0; /* gives no bias */
    assert_true(population_choose(p, 50, POPULATION_HIGH_ENERGY, &r, chosen, NULL));
    for (uint32_t k = 0; k < 50; k++) assert_int_equal(chosen[k], k);
    particles_free(p);
}

static void twins_are_on_the_surface(void **state)
{
    (void)state;
    analytic *a = analytic_new(&shapes[0], NULL, NULL);
    particles *p = particles_new(2, NULL);
    vec3 center = shapes[0].center, top = {center.x, center.y, center.z + 3};
    rng r = rng_seed(test_seed(), 1);
    p->count = 1;
    p->position[0] = top;
    p->normal[0] = (vec3){0, 0, 1};
    p->alpha[0] = 0.3;
    assert_true(population_split(&a->base, p, 0, 0.1, &r));
    assert_int_equal(p->count, 2);
    assert_true(p->alpha[0] == 0.3 && p->alpha[1] == 0.3);
    for (size_t i = 0; i < 2; i++) {
        assert_close(vec3_norm(vec3_sub(p->position[i], center)), 3, 1e-4);
        assert_close(vec3_norm(vec3_sub(p->position[i], top)), 0.1, 1e-3);
        assert_true(vec3_dot(p->normal[i], vec3_sub(p->position[i], center)) > 2.99);
    }
    assert_close(vec3_norm(vec3_sub(p->position[0], p->position[1])), 0.2, 1e-3);
    particles_free(p);
    analytic_free(a);
}

/* ---- complete solves */

typedef struct solved {
    analytic *a;
    threads *pool;
    surface *scan;
    solver *s;
    const solver_points *points;
    size_t inserted, deleted;
} solved;

static solver_params bounded(size_t start, size_t min_count, double max_sigma)
{
    return (solver_params){.count = start,
                           .min_count = min_count,
                           .max_sigma = max_sigma,
                           .seed = 1,
                           .max_sweeps = 5000,
                           .list_limit = SIZE_MAX,
                           .step_tolerance = 1e-3,
                           .energy_tolerance = 0.05};
}

static void solve(int shape, const solver_params *params, int workers, solved *x)
{
    error e = {0};
    *x = (solved){0};
    x->a = analytic_new(&shapes[shape], NULL, &e);
    x->pool = threads_new(workers, NULL, &e);
    x->scan = surface_scan(&x->a->base, x->pool, &e);
    x->s = solver_new(&x->a->base, x->scan, params, x->pool, &e);
    if (!x->s) fail_msg("%s", e.message);
    while (!solver_ended(x->s))
        if (!solver_step(x->s, &e)) fail_msg("%s", e.message);
    assert_true(solver_finalize(x->s, &e));
    x->points = solver_result_points(x->s);
    size_t rounds, before = params->count;
    const solver_round *round = solver_rounds(x->s, &rounds);
    for (size_t k = 0; k < rounds; k++) { /* the records account for all changes of the count */
        assert_int_equal(round[k].count, before);
        before = before + round[k].inserted - round[k].deleted;
        assert_true(before >= params->min_count);
        assert_true(round[k].sigma <= params->max_sigma * (1 + 1e-12));
        x->inserted += round[k].inserted;
        x->deleted += round[k].deleted;
    }
    assert_int_equal(x->points->count, before);
}

static void release(solved *x)
{
    solver_free(x->s);
    surface_free(x->scan);
    threads_free(x->pool);
    analytic_free(x->a);
}

/* The solve has converged, both bounds hold, and the number of particles is the smallest possible: a packing
 * with the support max_sigma has 6 A / (sqrt 3 max_sigma^2) points. */
static void expect_bounds(const solved *x, size_t min_count, double max_sigma)
{
    double direct = 6 * x->scan->area / (sqrt(3) * max_sigma * max_sigma);
    assert_int_equal(solver_result(x->s), SOLVER_CONVERGED);
    assert_int_equal(x->points->lost, 0);
    assert_true(x->points->count >= min_count);
    assert_true(x->points->sigma <= max_sigma * (1 + 1e-12));
    assert_true(fabs(x->points->mean_energy / x->points->ideal_energy - 1) < 0.05);
    assert_close((double)x->points->count / fmax(direct, (double)min_count), 1, 0.03);
}

static void particles_are_inserted_until_sigma_is_within_its_bound(void **state)
{
    (void)state;
    for (int unbiased = 0; unbiased < 2; unbiased++) {
        solver_params params = bounded(20, 20, SIGMA);
        params.unbiased = unbiased;
        solved x;
        solve(QUARTIC, &params, 1, &x);
        expect_bounds(&x, 20, SIGMA);
        assert_true(x.inserted >= 430);
        release(&x);
    }
}

static void particles_are_deleted_while_sigma_allows(void **state)
{
    (void)state;
    for (int unbiased = 0; unbiased < 2; unbiased++) {
        solver_params params = bounded(1000, 250, SIGMA);
        params.unbiased = unbiased;
        solved x;
        solve(QUARTIC, &params, 1, &x);
        expect_bounds(&x, 250, SIGMA);
        assert_true(x.deleted >= 430);
        release(&x);
    }
}

/* With a narrow tolerance, a single surplus particle does not restart the control. */
static void a_narrow_tolerance_is_met(void **state)
{
    (void)state;
    for (size_t start = 150; start <= 1500; start *= 10) {
        solver_params params = bounded(start, 150, SIGMA);
        params.energy_tolerance = 1e-3;
        solved x;
        solve(QUARTIC, &params, 1, &x);
        expect_bounds(&x, 150, SIGMA);
        assert_true(fabs(x.points->mean_energy / x.points->ideal_energy - 1) < 1e-3);
        release(&x);
    }
}

static void the_minimum_count_is_kept(void **state)
{
    (void)state;
    for (size_t start = 720; start <= 1200; start += 480) {
        solver_params params = bounded(start, 720, SIGMA);
        solved x;
        solve(QUARTIC, &params, 1, &x);
        expect_bounds(&x, 720, SIGMA);
        assert_int_equal(x.points->count, 720);
        assert_true(x.points->sigma < SIGMA);
        release(&x);
    }
}

static void control_works_with_amplitudes_and_boundaries(void **state)
{
    (void)state;
    solver_params params = bounded(100, 100, 0.1);
    params.graded = true;
    params.d = 2, params.gamma = 0.1, params.nu = 0.75, params.kappa_max = 20;
    for (int shape = QUARTIC; shape < SHAPE_COUNT; shape++) { /* quartic and gyroid */
        solved x;
        solve(shape, &params, 1, &x);
        assert_int_equal(solver_result(x.s), SOLVER_CONVERGED);
        assert_true(x.points->count >= 100 && x.points->sigma <= 0.1 * (1 + 1e-12));
        assert_true(fabs(x.points->mean_energy / x.points->ideal_energy - 1) < 0.05);
        release(&x);
    }
}

static void result_does_not_depend_on_threads(void **state)
{
    (void)state;
    solver_params params = bounded(50, 50, 0.14);
    solved one, many;
    solve(QUARTIC, &params, 1, &one);
    solve(QUARTIC, &params, 3, &many);
    assert_int_equal(one.points->count, many.points->count);
    assert_memory_equal(one.points->position, many.points->position, one.points->count * sizeof(vec3));
    release(&one);
    release(&many);
}

static void a_count_beyond_memory_is_an_error(void **state)
{
    (void)state;
    error e = {0};
    solver_params params = bounded(50, 50, 0.05);
    params.count_limit = 1000;
    analytic *a = analytic_new(&shapes[QUARTIC], NULL, NULL);
    threads *pool = threads_new(1, NULL, NULL);
    surface *scan = surface_scan(&a->base, pool, NULL);
    solver *s = solver_new(&a->base, scan, &params, pool, &e);
    bool ok = true;
    while (ok && !solver_ended(s)) ok = solver_step(s, &e);
    assert_false(ok);
    assert_int_equal(e.code, ERROR_LIMIT_MEMORY);
    solver_free(s);
    surface_free(scan);
    threads_free(pool);
    analytic_free(a);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(growing_keeps_particles),
        cmocka_unit_test(removal_keeps_the_order),
        cmocka_unit_test(the_choice_follows_its_bias),
        cmocka_unit_test(all_particles_can_be_chosen),
        cmocka_unit_test(twins_are_on_the_surface),
        cmocka_unit_test(particles_are_inserted_until_sigma_is_within_its_bound),
        cmocka_unit_test(particles_are_deleted_while_sigma_allows),
        cmocka_unit_test(a_narrow_tolerance_is_met),
        cmocka_unit_test(the_minimum_count_is_kept),
        cmocka_unit_test(control_works_with_amplitudes_and_boundaries),
        cmocka_unit_test(result_does_not_depend_on_threads),
        cmocka_unit_test(a_count_beyond_memory_is_an_error),
    };
    return cmocka_run_group_tests_name("control", tests, NULL, NULL);
}
