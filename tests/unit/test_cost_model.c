// SPDX-License-Identifier: Apache-2.0
/* cost_model: against jobs of known cost. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "base/core/rng.h"
#include "job/phases/cost_model.h"

/* Seconds of a run: a constant part and a power of the count, with noise. */
typedef struct cost {
    double fixed, each, power, noise;
} cost;

static double cost_of(const cost *c, size_t count, rng *r)
{
    return c->fixed + c->each * pow((double)count, c->power) * (1 + c->noise * (2 * rng_uniform(r) - 1));
}

/* Time spent on runs, including the last one, and the largest count that fitted. */
static double spend(const cost *c, double budget, size_t most, rng *r, size_t *reached)
{
    cost_model p = cost_model_begin(most);
    double spent = 0;
    *reached = 0;
    for (size_t count = COST_MODEL_FIRST; count > 0; count = cost_model_next(&p, budget - spent)) {
        double run = cost_of(c, count, r);
        if (*reached > 0) assert_true((double)count <= 6.001 * (double)*reached && count > *reached);
        if (spent + run > budget) return budget;
        spent += run;
        *reached = count;
        cost_model_note(&p, count, run, 0.1 * run);
        assert_true(fabs(cost_model_rest(&p, 2 * count) - 0.2 * run) < 1e-9 * run);
    }
    return spent;
}

static void most_of_the_time_is_used(void **state)
{
    (void)state;
    const cost costs[] = {{0, 1e-5, 1, 0}, {0, 2e-6, 1.2, 0}, {0.005, 1e-5, 1, 0}, {0.001, 3e-4, 0.9, 0}};
    rng r = rng_seed(1, 1);
    for (size_t k = 0; k < sizeof costs / sizeof costs[0]; k++)
        for (double budget = 1; budget < 4000; budget *= 1.7) {
            size_t reached;
            double spent = spend(&costs[k], budget, SIZE_MAX, &r, &reached);
            if (spent < 0.5 * budget || spent > budget) fail_msg("cost %zu: %g of %g s", k, spent, budget);
            /* at least about a third of the best count of a single run with the whole time */
            double best = pow((budget - costs[k].fixed) / costs[k].each, 1 / costs[k].power);
            if ((double)reached < 0.35 * best)
                fail_msg("cost %zu: %zu of %g in %g s", k, reached, best, budget);
        }
}

/* A run time that varies by a tenth still fits. */
static void varying_run_times_stay_within_the_time(void **state)
{
    (void)state;
    const cost noisy = {0.01, 1e-5, 1.1, 0.1};
    rng r = rng_seed(2, 1);
    int late = 0;
    double least = 1;
    for (int k = 0; k < 300; k++) {
        size_t reached;
        double budget = 2 + 100 * rng_uniform(&r), spent = spend(&noisy, budget, SIZE_MAX, &r, &reached);
        least = fmin(least, spent / budget);
        late += spent >= budget;
    }
    print_message("# at least %.2f of the time, %d of 300 broken off\n", least, late);
    assert_true(least >= 0.45 && late <= 6);
}

static void memory_bounds_the_count(void **state)
{
    (void)state;
    const cost cheap = {0, 1e-7, 1, 0};
    rng r = rng_seed(3, 1);
    size_t reached;
    double spent = spend(&cheap, 100, 5000, &r, &reached);
    assert_int_equal(reached, 5000);
    assert_true(spent < 1);
}

static void no_count_fits_into_zero_time(void **state)
{
    (void)state;
    cost_model p = cost_model_begin(SIZE_MAX);
    cost_model_note(&p, COST_MODEL_FIRST, 1, 0.1);
    assert_int_equal(cost_model_next(&p, 0), 0);
    assert_int_equal(cost_model_next(&p, -1), 0);
    assert_int_equal(cost_model_next(&p, 1), 0);
    cost_model_note(&p, COST_MODEL_FIRST, 0, 0); /* shorter than the resolution of the clock */
    assert_true(cost_model_next(&p, 1) > COST_MODEL_FIRST);
}

static void assert_between(double x, double low, double high)
{
    if (!(x >= low && x <= high)) fail_msg("%g is not between %g and %g", x, low, high);
}

/* The sweeps of meshes with 10 000 points take 3.8 times as long as those with 2 500 (median over bob, armadillo,
 * rocker-arm, spot, fertility, fandisk and cow), and the jobs with 50 000 points 1.7 times as long as those with 10 000
 * (median of measurements/meshes/counts.csv). */
static void work_by_levels_grows_as_times_do(void **state)
{
    (void)state;
    const double work = cost_model_work(10000, true);
    assert_between(work / cost_model_work(2500, true), 3.2, 4.4);
    assert_between(cost_model_work(50000, true) / work, 1.5, 2.2);
    assert_between(cost_model_work(1000000, true) / cost_model_work(50000, true), 5, 20);
}

static void work_without_levels_is_proportional_to_the_points(void **state)
{
    (void)state;
    assert_float_equal(cost_model_work(8000, false) / cost_model_work(500, false), 16, 1e-9);
    assert_true(cost_model_work(1, true) > 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(most_of_the_time_is_used),
        cmocka_unit_test(varying_run_times_stay_within_the_time),
        cmocka_unit_test(memory_bounds_the_count),
        cmocka_unit_test(no_count_fits_into_zero_time),
        cmocka_unit_test(work_by_levels_grows_as_times_do),
        cmocka_unit_test(work_without_levels_is_proportional_to_the_points),
    };
    return cmocka_run_group_tests_name("pace", tests, NULL, NULL);
}
