// SPDX-License-Identifier: Apache-2.0
/* The method of 1994: its formulas against finite differences and a lattice, and the statements of the paper
 * of 2005 about it in section 3. It is homogeneous for uniform targets. For varying targets, insertion and
 * deletion form an endless cycle or, with more hysteresis, the result is homogeneous nevertheless.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "sampling/solver/solver.h"
#include "measure_result.h"
#include "shapes.h"

enum { SPHERE = 0, BOX = 2, QUARTIC = 4, GYROID = 5 };

static const witkin_heckbert_params defaults = {6, 0.8, 15, 15, 10, 0.03, 4, 0.2, 0.7, 0};

/* ---- formulas ---- */

enum { FEW = 12 };

typedef struct few {
    vec3 x[FEW], velocity[FEW];
    double sigma[FEW];
    uint32_t list[FEW][FEW];
} few;

/* Particles a few radii apart, none at the truncation of a Gaussian. */
static few few_particles(void)
{
    few f;
    rng r = rng_seed(test_seed(), 1);
    for (uint32_t i = 0; i < FEW; i++) {
        f.x[i] = random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1});
        f.velocity[i] = random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1});
        f.sigma[i] = 0.9 + 0.4 * rng_uniform(&r);
        for (uint32_t j = 0, k = 0; j < FEW; j++)
            if (j != i) f.list[i][k++] = j;
    }
    return f;
}

static witkin_heckbert_terms terms_of(const few *f, size_t i)
{
    witkin_heckbert_terms t;
    witkin_heckbert_sum(&defaults, f->x, f->sigma, i, f->list[i], FEW - 1, &t);
    return t;
}

/* E_i of the paper: the particle's Gaussian at the others, and their Gaussians at the particle. */
static double energy_of(const few *f, size_t i)
{
    double sum = 0;
    for (size_t j = 0; j < FEW; j++) {
        double r2 = vec3_norm2(vec3_sub(f->x[i], f->x[j]));
        if (j == i) continue;
        sum += defaults.alpha * exp(-r2 / (2 * f->sigma[i] * f->sigma[i]));
        sum += defaults.alpha * exp(-r2 / (2 * f->sigma[j] * f->sigma[j]));
    }
    return sum;
}

static void displacement_follows_the_energy_gradient(void **state)
{
    (void)state;
    const double step = 1e-5;
    few f = few_particles();
    for (size_t i = 0; i < FEW; i++) {
        witkin_heckbert_terms t = terms_of(&f, i);
        for (int axis = 0; axis < 3; axis++) {
            few low = f, high = f;
            vec3_set(&low.x[i], axis, vec3_get(f.x[i], axis) - step);
            vec3_set(&high.x[i], axis, vec3_get(f.x[i], axis) + step);
            double slope = (energy_of(&high, i) - energy_of(&low, i)) / (2 * step);
            assert_close(vec3_get(t.push, axis), -f.sigma[i] * f.sigma[i] * slope, 1e-6);
        }
    }
}

static void radius_growth_is_the_derivative_of_the_energy(void **state)
{
    (void)state;
    const double step = 1e-5;
    few f = few_particles();
    for (size_t i = 0; i < FEW; i++) {
        few low = f, high = f;
        low.sigma[i] -= step;
        high.sigma[i] += step;
        double slope = (terms_of(&high, i).energy - terms_of(&low, i).energy) / (2 * step);
        assert_close(terms_of(&f, i).growth, f.sigma[i] * slope, 1e-6);
    }
}

/* Without beta the radius changes such that D follows its feedback while all particles move. */
static void radii_make_energies_follow_their_feedback(void **state)
{
    (void)state;
    const double step = 1e-5;
    few f = few_particles();
    witkin_heckbert_params pure = defaults;
    pure.beta = 0;
    for (size_t i = 0; i < FEW; i++) {
        witkin_heckbert_terms t = terms_of(&f, i);
        double rate = witkin_heckbert_radius_rate(&pure, f.x, f.velocity, f.sigma, i, f.list[i], FEW - 1, &t);
        few low = f, high = f;
        low.sigma[i] -= step * rate;
        high.sigma[i] += step * rate;
        for (size_t j = 0; j < FEW; j++) {
            low.x[j] = vec3_axpy(-step, f.velocity[j], f.x[j]);
            high.x[j] = vec3_axpy(step, f.velocity[j], f.x[j]);
        }
        double change = (terms_of(&high, i).energy - terms_of(&low, i).energy) / (2 * step);
        assert_close(change, -pure.rho * (t.energy - pure.e_hat * pure.alpha), 1e-4);
    }
}

static void a_lattice_of_that_packing_has_the_desired_energy(void **state)
{
    (void)state;
    for (double e_hat = 0.4; e_hat < 3; e_hat *= 2) {
        witkin_heckbert_params params = defaults;
        params.e_hat = e_hat;
        double h = witkin_heckbert_packing(&params);
        enum { REACH = 8, SIDE = 2 * REACH + 1 };
        vec3 x[SIDE * SIDE];
        double sigma[SIDE * SIDE];
        uint32_t list[SIDE * SIDE], count = 0;
        const size_t middle = REACH * SIDE + REACH;
        for (int a = 0; a < SIDE; a++)
            for (int b = 0; b < SIDE; b++) {
                uint32_t i = (uint32_t)(a * SIDE + b);
                x[i] = (vec3){h * (a - REACH + 0.5 * (b - REACH)), h * sqrt(3) / 2 * (b - REACH), 0};
                sigma[i] = 1;
                if (i != middle) list[count++] = i;
            }
        witkin_heckbert_terms t;
        witkin_heckbert_sum(&params, x, sigma, middle, list, count, &t);
        assert_close(t.energy / params.alpha, e_hat, 1e-2 * e_hat); /* the effect of the truncation */
        assert_close(vec3_norm(t.push), 0, 1e-12);
    }
}

/* ---- complete solves */

typedef struct solved {
    analytic *a;
    threads *pool;
    surface *scan;
    solver *s;
    const solver_points *points;
    measures q;
    const solver_sweep *sweep;
    size_t sweeps;
} solved;

enum { COUNT = 600 };

static solver_params even_targets(const witkin_heckbert_params *w)
{
    return (solver_params){.witkin_heckbert = w,
                           .count = COUNT,
                           .seed = 1,
                           .max_sweeps = 2000,
                           .list_limit = SIZE_MAX,
                           .step_tolerance = 0.02,
                           .energy_tolerance = 0.05};
}

static solver_params varied_targets(const witkin_heckbert_params *w, double d)
{
    solver_params params = even_targets(w);
    params.graded = true;
    params.d = d;
    params.gamma = 0.1;
    params.nu = 0.75;
    params.kappa_max = 20;
    return params;
}

static void solve(const analytic_params *shape, const solver_params *params, int workers, solved *x)
{
    error e = {0};
    *x = (solved){0};
    x->a = analytic_new(shape, NULL, &e);
    x->pool = threads_new(workers, NULL, &e);
    x->scan = surface_scan(&x->a->base, x->pool, &e);
    x->s = solver_new(&x->a->base, x->scan, params, x->pool, &e);
    if (!x->s) fail_msg("%s", e.message);
    while (!solver_ended(x->s))
        if (!solver_step(x->s, &e)) fail_msg("%s", e.message);
    if (!solver_finalize(x->s, &e)) fail_msg("%s", e.message);
    x->points = solver_result_points(x->s);
    x->sweep = solver_sweeps(x->s, &x->sweeps);
    x->q = measure_result(x->scan, x->s, false, x->pool);
    assert_int_equal(x->points->lost, 0);
    assert_true(x->points->max_residual < 1e-6);
    size_t count = params->count; /* the records account for all changes of the count */
    for (size_t k = 0; k < x->sweeps; k++) {
        count = count + x->sweep[k].inserted - x->sweep[k].deleted;
        assert_int_equal(x->sweep[k].count, count);
    }
    assert_int_equal(x->points->count, count);
}

static void release(solved *x)
{
    solver_free(x->s);
    surface_free(x->scan);
    threads_free(x->pool);
    analytic_free(x->a);
}

/* Number of particles that split or died in the last steps. */
static size_t turnover(const solved *x, size_t steps)
{
    size_t sum = 0;
    for (size_t k = x->sweeps - steps; k < x->sweeps; k++) sum += x->sweep[k].inserted + x->sweep[k].deleted;
    return sum;
}

/* The largest distance, in h, of a point of the sphere from the nearest particle; 1 / sqrt 3 is ideal. */
static double largest_gap(const solved *x, const analytic_params *sphere)
{
    rng r = rng_seed(7, 1);
    double worst = 0;
    for (int k = 0; k < 10000; k++) {
        vec3 u = vec3_unit(random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1}));
        vec3 p = vec3_axpy(sphere->radius, u, sphere->center);
        double nearest2 = INFINITY;
        for (size_t i = 0; i < x->points->count; i++)
            nearest2 = fmin(nearest2, vec3_norm2(vec3_sub(p, x->points->position[i])));
        worst = fmax(worst, nearest2);
    }
    return sqrt(worst) / solver_spacing(x->s);
}

static void even_targets_give_an_even_sphere(void **state)
{
    (void)state;
    for (int random = 0; random < 2; random++) {
        solver_params params = even_targets(&defaults);
        params.start = random ? SOLVER_START_RANDOM : SOLVER_START_SURFACE;
        solved x;
        solve(&shapes[SPHERE], &params, 1, &x);
        double gap = largest_gap(&x, &shapes[SPHERE]);
        print_message("# %zu points, hex %.3f, spacing varies by %.4f, gap %.3f h\n", x.points->count,
                      x.q.hex_fraction, x.q.grading_cv, gap);
        assert_true(solver_result(x.s) != SOLVER_OUT_OF_SWEEPS && turnover(&x, 50) == 0);
        assert_close((double)x.points->count, COUNT, 0.12 * COUNT);
        assert_close(x.points->mean_energy / x.points->ideal_energy, 1, 1e-3);
        assert_true(gap < 0.8 && x.q.grading_cv < 0.03 && x.q.min_spacing_ratio > 0.7);
        assert_close(x.q.euler, 2, 1e-9);
        release(&x);
    }
}

/* The requested contrast of spacing, and the exponent by which the spacing follows it. */
static double contrast(const solved *x)
{
    double low = INFINITY, high = 0;
    for (size_t i = 0; i < x->points->count; i++) {
        low = fmin(low, x->points->spacing[i]);
        high = fmax(high, x->points->spacing[i]);
    }
    return high / low;
}

static void varied_targets_never_converge(void **state)
{
    (void)state;
    const double d[] = {1, 3};
    for (int k = 0; k < 2; k++) {
        solver_params params = varied_targets(&defaults, d[k]);
        params.max_sweeps = 800;
        solved x;
        solve(&shapes[QUARTIC], &params, 1, &x);
        size_t last = turnover(&x, 100), later = turnover(&x, 500);
        print_message(
            "# d = %g: %zu of %zu particles split or died in the last 100 of 800 steps; of a contrast of "
            "%.1f the spacing has exponent %.2f, cv %.2f\n",
            d[k], last, x.points->count, contrast(&x), x.q.grading_exponent, x.q.grading_cv);
        assert_int_equal(solver_result(x.s), SOLVER_OUT_OF_SWEEPS);
        assert_true(last > x.points->count / 2);             /* it continues */
        assert_true((double)later > 0.8 * 5 * (double)last); /* and does not decrease */
        assert_true((double)later < 1.25 * 5 * (double)last);
        assert_true(contrast(&x) > 2 && x.q.grading_exponent < 0.8);
        assert_true(x.q.grading_cv > 0.1); /* several times that of a uniform sphere */
        release(&x);
    }
}

/* "when we tuned parameters to stop the insertion-deletion cycle by expanding the hysteresis of insertion and
 * deletion we found that the particle distributions did not reflect the desired differences in particle
 * densities" */
static void hysteresis_ends_the_cycle_and_the_contrast(void **state)
{
    (void)state;
    witkin_heckbert_params wide = defaults;
    wide.delta = 0.1;
    solver_params params = varied_targets(&wide, 1);
    solved x;
    solve(&shapes[QUARTIC], &params, 1, &x);
    print_message("# at rest after %zu steps; of a contrast of %.1f the spacing has exponent %.3f\n",
                  x.sweeps, contrast(&x), x.q.grading_exponent);
    assert_true(x.sweeps < 2000 && turnover(&x, 50) == 0);
    assert_true(contrast(&x) > 2 && fabs(x.q.grading_exponent) < 0.05);
    release(&x);
}

static analytic_params scaled(const analytic_params *shape, double factor)
{
    analytic_params p = *shape;
    p.center = vec3_scale(p.center, factor);
    p.radius *= factor;
    p.r *= factor;
    return p;
}

/* Scaling by a power of two changes no digit. Scaling by other factors changes no measure. */
static void the_size_of_a_surface_does_not_matter(void **state)
{
    (void)state;
    solver_params params = varied_targets(&defaults, 1);
    params.max_sweeps = 200;
    solved one, large;
    analytic_params doubled = scaled(&shapes[QUARTIC], 1024);
    solve(&shapes[QUARTIC], &params, 1, &one);
    solve(&doubled, &params, 1, &large);
    assert_int_equal(one.points->count, large.points->count);
    for (size_t i = 0; i < one.points->count; i++)
        assert_true(vec3_norm(vec3_sub(vec3_scale(one.points->position[i], 1024),
                                       large.points->position[i])) < 1e-6 * solver_spacing(large.s));
    release(&one);
    release(&large);

    params = even_targets(&defaults);
    analytic_params thousand = scaled(&shapes[SPHERE], 1000);
    solve(&shapes[SPHERE], &params, 1, &one);
    solve(&thousand, &params, 1, &large);
    assert_close((double)large.points->count / (double)one.points->count, 1, 0.01);
    assert_close(solver_spacing(large.s) / solver_spacing(one.s), 1000, 5);
    assert_close(large.points->sigma / one.points->sigma, 1000, 5);
    assert_close(large.q.hex_fraction, one.q.hex_fraction, 0.05);
    release(&one);
    release(&large);
}

static void creases_and_rims_hold(void **state)
{
    (void)state;
    analytic_params sharp = shapes[BOX];
    sharp.rounding = 0;
    const analytic_params *hard[] = {&sharp, &shapes[GYROID]};
    for (int k = 0; k < 2; k++) {
        solver_params params = even_targets(&defaults);
        params.count = 800;
        solved x;
        solve(hard[k], &params, 1, &x);
        assert_close(x.points->mean_energy / x.points->ideal_energy, 1, 0.01);
        assert_close((double)x.points->count, 800, 240); /* boundaries need more */
        assert_true(x.q.min_spacing_ratio > 0.6);
        for (size_t i = 0; x.a->base.open && i < x.points->count; i++)
            assert_true(bbox_contains(x.a->base.domain, x.points->position[i]));
        release(&x);
    }
}

static void result_does_not_depend_on_threads(void **state)
{
    (void)state;
    solver_params params = varied_targets(&defaults, 2);
    params.max_sweeps = 120;
    solved one, many;
    solve(&shapes[QUARTIC], &params, 1, &one);
    solve(&shapes[QUARTIC], &params, 3, &many);
    assert_int_equal(one.points->count, many.points->count);
    assert_memory_equal(one.points->position, many.points->position, one.points->count * sizeof(vec3));
    assert_memory_equal(one.points->energy, many.points->energy, one.points->count * sizeof(double));
    release(&one);
    release(&many);
}

/* The mean energy of the particles' own Gaussians in the report. */
static void energies_of_points_have_the_reported_mean(void **state)
{
    (void)state;
    solver_params params = varied_targets(&defaults, 2);
    params.max_sweeps = 120;
    solved x;
    solve(&shapes[QUARTIC], &params, 1, &x);
    double sum = 0;
    for (size_t i = 0; i < x.points->count; i++) sum += x.points->energy[i];
    assert_true(x.points->mean_energy > 0);
    assert_close(sum / (double)x.points->count, x.points->mean_energy, 1e-9 * x.points->mean_energy);
    release(&x);
}

static void tiny_counts_work(void **state)
{
    (void)state;
    for (size_t count = 4; count <= 22; count += 6) {
        solver_params params = even_targets(&defaults);
        params.count = count;
        solved x;
        solve(&shapes[SPHERE], &params, 1, &x);
        assert_true(x.points->count >= 4 && x.points->count <= 2 * count);
        release(&x);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(displacement_follows_the_energy_gradient),
        cmocka_unit_test(radius_growth_is_the_derivative_of_the_energy),
        cmocka_unit_test(radii_make_energies_follow_their_feedback),
        cmocka_unit_test(a_lattice_of_that_packing_has_the_desired_energy),
        cmocka_unit_test(even_targets_give_an_even_sphere),
        cmocka_unit_test(varied_targets_never_converge),
        cmocka_unit_test(hysteresis_ends_the_cycle_and_the_contrast),
        cmocka_unit_test(the_size_of_a_surface_does_not_matter),
        cmocka_unit_test(creases_and_rims_hold),
        cmocka_unit_test(result_does_not_depend_on_threads),
        cmocka_unit_test(energies_of_points_have_the_reported_mean),
        cmocka_unit_test(tiny_counts_work),
    };
    return cmocka_run_group_tests_name("witkin_heckbert", tests, NULL, NULL);
}
