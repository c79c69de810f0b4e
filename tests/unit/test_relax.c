// SPDX-License-Identifier: Apache-2.0
/* Sweeps: guarantees about the energy, the surface and the neighbour lists. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "surface/field/projection.h"
#include "sampling/solver/passes/relax.h"
#include "shapes.h"
#include "surface/scan/surface.h"

enum { COUNT = 600 };

typedef struct bench {
    analytic *a;
    threads *pool;
    surface *scan;
    particles *p;
    relax *r;
    relax_params params;
} bench;

static void set_up_on(bench *b, const analytic_params *shape, size_t count, const fast_kernel *forces,
                      uint64_t stream)
{
    error e = {0};
    rng r = rng_seed(test_seed(), stream);
    const projection_limits limits = {20, 1e-9, 1e-8, 1e-6};
    b->a = analytic_new(shape, NULL, &e);
    b->pool = threads_new(2, NULL, &e);
    b->scan = surface_scan(&b->a->base, b->pool, &e);
    b->p = particles_new(count, &e);
    b->r = relax_new(count, &energy_cotangent, forces, SIZE_MAX, b->pool, &e);
    assert_non_null(b->r);
    for (size_t i = 0; i < count;) {
        vec3 x = surface_point(b->scan, b->scan->area_before, rng_uniform(&r) * b->scan->area, &r, NULL);
        if (!projection_find(&b->a->base, &limits, &x, &b->p->normal[i])) continue;
        b->p->alpha[i] = forces ? 1 : 0.5 + rng_uniform(&r);
        b->p->position[i++] = x;
    }
    double h = sqrt(2 * b->scan->area / (sqrt(3) * count));
    b->params = (relax_params){.field = &b->a->base,
                               .sigma = sqrt(3) * h,
                               .spacing = h,
                               .omega = 2.6,
                               .fast_step = INFINITY,
                               .gain = 1e-9};
}

static void set_up(bench *b, int shape, const fast_kernel *forces, uint64_t stream)
{
    set_up_on(b, &shapes[shape], COUNT, forces, stream);
}

static void tear_down(bench *b)
{
    relax_free(b->r);
    particles_free(b->p);
    surface_free(b->scan);
    threads_free(b->pool);
    analytic_free(b->a);
}

/* Pairs are symmetric, and a step is accepted only if it lowers the particle's own energy. The energy of the
 * system therefore cannot rise: not with unequal amplitudes, not across creases, not while lists age. */
static void energy_never_rises(void **state)
{
    (void)state;
    error e = {0};
    for (int shape = 0; shape < SHAPE_COUNT; shape++) {
        bench b;
        set_up(&b, shape, NULL, (uint64_t)shape);
        double before = INFINITY;
        for (int sweep = 0; sweep < 60; sweep++) {
            if (sweep % 3 == 0)
                assert_true(relax_build(b.r, b.p, b.params.sigma, 0.4 * b.params.spacing, &e));
            double energy = relax_mean_energy(b.r, b.p, b.params.sigma);
            /* a step along a normal that is wrong by a Newton step may cost energy that `gain` does not
             * include */
            if (energy > before * (1 + 1e-7))
                fail_msg("%s, sweep %d: %.12g after %.12g", shape_names[shape], sweep, energy, before);
            before = energy;
            relax_sums sums;
            relax_sweep(b.r, b.p, &b.params, &sums);
            assert_true(sums.rms_step <= sums.max_step);
        }
        tear_down(&b);
    }
}

/* The same for guarded steps in SIMD lanes, which are taken where most neighbours' normals diverge. The limit of
 * fast steps, which have no energy test, is 0. */
static void energy_never_rises_by_guarded_steps_in_lanes(void **state)
{
    (void)state;
    enum { MANY = 4200 };
    static const analytic_params folds = {
        .shape = ANALYTIC_GYROID, .center = {0.5, 0.5, 0.5}, .size = {1, 1, 1}, .period = 0.16};
    for (int ignores_normals = 0; ignores_normals < 2; ignores_normals++) {
        error e = {0};
        bench b;
        rng r = rng_seed(test_seed(), 51);
        set_up_on(&b, &folds, MANY, fast_kernel_for(isa_best()), 50);
        b.params.fast_step = 0;
        for (size_t i = 0; i < MANY; i++) b.p->alpha[i] = exp(-5 * rng_uniform(&r));
        if (ignores_normals) relax_ignore_normals(b.r);
        double before = INFINITY, first = 0;
        for (int sweep = 0; sweep < 60; sweep++) {
            relax_sums sums;
            if (sweep % 3 == 0)
                assert_true(relax_build(b.r, b.p, b.params.sigma, 0.6 * b.params.spacing, &e));
            const double energy = relax_mean_energy(b.r, b.p, b.params.sigma);
            assert_true(relax_has_mostly_divergent_normals(b.r));
            if (energy > before * (1 + 1e-5)) /* single precision */
                fail_msg("sweep %d: %.9g after %.9g", sweep, energy, before);
            if (sweep == 0) first = energy;
            before = energy;
            relax_sweep(b.r, b.p, &b.params, &sums);
        }
        assert_true(before < 0.9 * first);
        tear_down(&b);
    }
}

/* Two coincident particles have an unbounded energy; the energy of the packing hardly changes. */
static void coincident_points_do_not_set_the_support(void **state)
{
    (void)state;
    error e = {0};
    bench b;
    set_up(&b, 4, NULL, 3);
    relax_sums sums;
    assert_true(relax_build(b.r, b.p, b.params.sigma, b.params.spacing, &e));
    for (int sweep = 0; sweep < 20; sweep++) relax_sweep(b.r, b.p, &b.params, &sums);
    assert_true(relax_build(b.r, b.p, b.params.sigma, 0, &e));
    const double before = relax_packing_energy(b.r, b.p, b.params.sigma);
    assert_true(before == relax_mean_energy(b.r, b.p, b.params.sigma));
    b.p->position[1] = vec3_axpy(1e-7 * b.params.spacing,
                                 vec3_unit(vec3_cross(b.p->normal[0], (vec3){1, 2, 3})), b.p->position[0]);
    b.p->normal[1] = b.p->normal[0];
    assert_true(relax_build(b.r, b.p, b.params.sigma, 0, &e));
    assert_true(fabs(relax_packing_energy(b.r, b.p, b.params.sigma) / before - 1) < 0.05);
    assert_true(relax_mean_energy(b.r, b.p, b.params.sigma) > 10 * before);
    tear_down(&b);
}

/* No particle moves farther from its position at the build of the lists than they permit, nor off the
 * surface; also if they were built for a smaller support. */
static void check_lists_stay_valid(const fast_kernel *forces, double smaller)
{
    error e = {0};
    bench b;
    set_up(&b, 4, forces, 9);
    double skin = 0.3 * b.params.spacing, less = smaller * b.params.spacing;
    assert_true(relax_build(b.r, b.p, b.params.sigma - less, skin + less, &e));
    relax_set_support(b.r, b.params.sigma);
    size_t limited = 0;
    vec3 built[COUNT];
    memcpy(built, b.p->position, sizeof built);
    for (int sweep = 0; sweep < 10; sweep++) {
        relax_sums sums;
        relax_sweep(b.r, b.p, &b.params, &sums);
        limited += sums.limited;
        for (size_t i = 0; i < COUNT; i++) {
            field_sample s;
            assert_true(vec3_norm(vec3_sub(b.p->position[i], built[i])) <= 0.5 * skin * (1 + 1e-6));
            assert_true(field_sample_at(&b.a->base, b.p->position[i], FIELD_GRADIENT, &s));
            assert_true(fabs(s.value) <= 0.01 * b.params.spacing * vec3_norm(s.gradient));
        }
    }
    assert_true(limited > 0); /* random starts require larger steps */
    tear_down(&b);
}

static void lists_stay_valid(void **state)
{
    (void)state;
    for (int k = 0; k < 2; k++) {
        check_lists_stay_valid(NULL, 0.1 * k);
        check_lists_stay_valid(fast_kernel_for(isa_best()), 0.1 * k);
    }
}

/* From the same start, sweeps without checks converge to the energy of sweeps with checks. */
static void sweeps_without_checks_converge_to_the_same_energy(void **state)
{
    (void)state;
    error e = {0};
    double energy[2], step[2];
    for (int way = 0; way < 2; way++) {
        bench b;
        set_up(&b, 0, way ? fast_kernel_for(isa_best()) : NULL, 4);
        for (size_t i = 0; i < COUNT; i++) b.p->alpha[i] = 1;
        b.params.omega = way ? 2.2 : 2.6;
        for (int sweep = 0; sweep < 300; sweep++) {
            relax_sums sums;
            if (sweep % 3 == 0)
                assert_true(relax_build(b.r, b.p, b.params.sigma, 0.4 * b.params.spacing, &e));
            relax_sweep(b.r, b.p, &b.params, &sums);
            step[way] = sums.rms_step;
        }
        energy[way] = relax_mean_energy(b.r, b.p, b.params.sigma);
        tear_down(&b);
    }
    assert_true(step[0] < 3e-3 && step[1] < 3e-3);
    assert_close(energy[1] / energy[0], 1, 3e-3);
}

/* Two surfaces closer than the support: particles interact only on their own side. */
static void opposite_surfaces_do_not_interact(void **state)
{
    (void)state;
    error e = {0};
    analytic_params plate = {.shape = ANALYTIC_BOX, .half_size = {2, 2, 0.03}, .rounding = 0};
    analytic *a = analytic_new(&plate, NULL, &e);
    threads *pool = threads_new(1, NULL, &e);
    particles *p = particles_new(2, &e);
    relax *r = relax_new(2, &energy_cotangent, NULL, SIZE_MAX, pool, &e);
    p->position[0] = (vec3){0.1, 0, 0.03};
    p->position[1] = (vec3){0.12, 0, -0.03};
    p->normal[0] = (vec3){0, 0, 1};
    p->normal[1] = (vec3){0, 0, -1};
    assert_true(relax_build(r, p, 1, 0.2, &e));
    assert_true(relax_mean_energy(r, p, 1) == 0);
    p->normal[1] = (vec3){0, 0, 1};
    assert_true(relax_build(r, p, 1, 0.2, &e));
    assert_true(relax_mean_energy(r, p, 1) > 1);
    relax_free(r);
    particles_free(p);
    threads_free(pool);
    analytic_free(a);
}

/* Refreshed lists give the same energies as new ones. */
static void refreshed_lists_give_the_energies_of_new_ones(void **state)
{
    (void)state;
    bench b;
    error e = {0};
    rng r = rng_seed(test_seed(), 9);
    set_up(&b, 1, fast_kernel_for(isa_best()), 5);
    double h = b.params.spacing, skin = 0.3 * h;
    assert_true(relax_build(b.r, b.p, b.params.sigma, skin, &e));
    for (size_t i = 0; i < COUNT; i++) {
        vec3 way = vec3_unit(random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1}));
        b.p->position[i] = vec3_axpy(0.1 * h * rng_uniform(&r), way, b.p->position[i]);
        b.p->size[i] = 1 + 0.02 * rng_uniform(&r);
    }
    assert_true(relax_refresh(b.r, b.p, b.params.sigma));
    double refreshed = relax_mean_energy(b.r, b.p, b.params.sigma);
    assert_true(relax_build(b.r, b.p, b.params.sigma, skin, &e));
    assert_close(relax_mean_energy(b.r, b.p, b.params.sigma), refreshed, 1e-6 * refreshed);
    tear_down(&b);
}

static void lists_that_do_not_cover_are_not_refreshed(void **state)
{
    (void)state;
    for (int way = 0; way < 3; way++) {
        bench b;
        error e = {0};
        set_up(&b, 1, fast_kernel_for(isa_best()), 6);
        double h = b.params.spacing, sigma = b.params.sigma;
        assert_true(relax_build(b.r, b.p, sigma, 0.3 * h, &e));
        if (way == 0) b.p->position[7].x += 0.16 * h;
        if (way == 1) b.p->size[7] = 1 + 0.32 * h / sigma;
        if (way == 2) sigma += 0.31 * h;
        assert_false(relax_refresh(b.r, b.p, sigma));
        tear_down(&b);
    }
}

/* The measurement of remaining steps also returns the energies, which are valid until a particle moves. */
static void energies_are_returned_with_the_remaining_steps(void **state)
{
    (void)state;
    bench b;
    error e = {0};
    relax_sums sums;
    float seen[COUNT];
    set_up(&b, 1, fast_kernel_for(isa_best()), 7);
    const double h = b.params.spacing, sigma = b.params.sigma, skin = 0.4 * h;
    for (int sweep = 0; sweep < 60; sweep++) {
        if (sweep % 4 == 0) assert_true(relax_build(b.r, b.p, sigma, skin, &e));
        relax_sweep(b.r, b.p, &b.params, &sums);
    }
    const double left = relax_rms_steps_left(b.r, b.p, sigma, h, false).all,
                 energy = relax_mean_energy(b.r, b.p, sigma);
    memcpy(seen, b.p->energy, sizeof seen);
    assert_true(relax_build(b.r, b.p, sigma, skin, &e));
    assert_close(relax_mean_energy(b.r, b.p, sigma), energy, 1e-6 * energy);
    for (size_t i = 0; i < COUNT; i++) assert_close((double)b.p->energy[i], (double)seen[i], 1e-5 * energy);
    assert_close(relax_rms_steps_left(b.r, b.p, sigma, h, false).all, left, 1e-5);
    for (int far = 0; far < 2; far++) {
        const double known = relax_rms_steps_left(b.r, b.p, sigma, h, false).all;
        for (size_t i = 0; i < COUNT; i += 2)
            b.p->position[i] =
                vec3_axpy((far ? 0.05 : 1e-6) * h, vec3_unit(vec3_cross(b.p->normal[i], (vec3){1, 2, 3})),
                          b.p->position[i]);
        assert_true(relax_refresh(b.r, b.p, sigma));
        assert_true((relax_rms_steps_left(b.r, b.p, sigma, h, false).all == known) == !far);
        assert_true((fabs(relax_mean_energy(b.r, b.p, sigma) - energy) < 1e-6 * energy) == !far);
    }
    relax_sweep(b.r, b.p, &b.params, &sums);
    assert_true(relax_rms_steps_left(b.r, b.p, sigma, h, false).all < 0.04);
    tear_down(&b);
}

/* A particle that fewer than three neighbours hold may drift without end at almost no energy, for example on
 * a droplet. Its step does not count for convergence, however many particles beyond the support are in its
 * list. */
static void particles_free_to_drift_have_no_remaining_step(void **state)
{
    (void)state;
    const double side[][2] = {{0, 0}, {1.5, 0}, {-1.9, 0}, {0, 1.9}}; /* in spacings */
    const projection_limits limits = {20, 1e-9, 1e-8, 1e-6};
    for (int nearer = 0; nearer < 2; nearer++) {
        bench b;
        error e = {0};
        set_up(&b, 1, fast_kernel_for(isa_best()), 7);
        const double h = b.params.spacing;
        const vec3 x = b.p->position[0];
        vec3 axis[2];
        vec3_frame(b.p->normal[0], &axis[0], &axis[1]);
        b.p->count = sizeof side / sizeof *side;
        for (size_t i = 0; i < b.p->count; i++) {
            const double scale = nearer ? 0.8 * h : h;
            b.p->position[i] =
                vec3_axpy(scale * side[i][0], axis[0], vec3_axpy(scale * side[i][1], axis[1], x));
            assert_true(projection_find(&b.a->base, &limits, &b.p->position[i], &b.p->normal[i]));
        }
        assert_true(relax_build(b.r, b.p, b.params.sigma, 0.6 * h, &e));
        const double left = relax_rms_steps_left(b.r, b.p, b.params.sigma, h, false).all;
        assert_true(nearer ? left > 0.01 : isnan(left));
        tear_down(&b);
    }
}

/* Compared with a computation over all pairs. */
static void divergent_share_is_that_of_all_pairs_within_the_lists(void **state)
{
    (void)state;
    for (int shape = 0; shape < SHAPE_COUNT; shape++) {
        bench b;
        error e = {0};
        set_up(&b, shape, NULL, 40 + (uint64_t)shape);
        const double skin = 0.6 * b.params.spacing, reach = b.params.sigma + skin;
        assert_true(relax_build(b.r, b.p, b.params.sigma, skin, &e));
        size_t divergent = 0;
        for (size_t i = 0; i < COUNT; i++) {
            bool diverges = false;
            for (size_t j = 0; j < COUNT; j++)
                diverges |= j != i && particles_facing(b.p, i, j) <= 0.5 &&
                            vec3_norm(vec3_sub(b.p->position[i], b.p->position[j])) < reach;
            divergent += diverges;
        }
        assert_close(relax_divergent_share(b.r, b.p), (double)divergent / COUNT, 1.5 / COUNT);
        tear_down(&b);
    }
}

/* The steps of displaced particles and of those near them are reported separately until displacements are
 * cleared. */
static void steps_of_displaced_particles_are_reported_separately(void **state)
{
    (void)state;
    bench b;
    error e = {0};
    relax_sums sums;
    set_up(&b, 1, fast_kernel_for(isa_best()), 8);
    const double h = b.params.spacing, sigma = b.params.sigma;
    relax_mark_displaced(b.r, b.p, 5); /* without lists */
    for (int sweep = 0; sweep < 80; sweep++) {
        if (sweep % 4 == 0) assert_true(relax_build(b.r, b.p, sigma, 0.4 * h, &e));
        relax_sweep(b.r, b.p, &b.params, &sums);
        assert_true(sums.displaced_step == 0 && sums.displaced_limited == 0);
    }
    relax_mark_displaced(b.r, b.p, 5);
    b.p->position[5] =
        vec3_axpy(0.3 * h, vec3_unit(vec3_cross(b.p->normal[5], (vec3){1, 2, 3})), b.p->position[5]);
    assert_true(relax_build(b.r, b.p, sigma, 0.4 * h, &e));
    relax_sweep(b.r, b.p, &b.params, &sums);
    assert_true(sums.displaced_step > 3 * sums.rms_step);
    relax_clear_displaced(b.r);
    relax_sweep(b.r, b.p, &b.params, &sums);
    assert_true(sums.displaced_step == 0);
    tear_down(&b);
}

/* Particles near convergence are skipped by sweeps that permit it, until a neighbour has moved far. They are
 * counted with their last energies. */
static void converged_particles_are_skipped(void **state)
{
    (void)state;
    error e = {0};
    bench b;
    relax_sums sums, before;
    vec3 rests[COUNT];
    set_up(&b, 0, fast_kernel_for(isa_best()), 17);
    const double h = b.params.spacing;
    b.params.omega = 1;
    for (int sweep = 0; sweep < 400; sweep++) {
        if (sweep % 10 == 0) assert_true(relax_build(b.r, b.p, b.params.sigma, 0.6 * h, &e));
        relax_sweep(b.r, b.p, &b.params, &before);
    }
    assert_true(before.max_step > 0 && before.max_step < 0.01);
    b.params.may_skip = true;
    relax_sweep(b.r, b.p, &b.params, &before); /* no particle may be skipped yet */
    assert_true(before.rms_step > 0);
    assert_true(relax_allow_skipping(b.r, &e));
    relax_sweep(b.r, b.p, &b.params, &before);
    assert_true(before.rms_step > 0);
    memcpy(rests, b.p->position, sizeof rests);
    relax_sweep(b.r, b.p, &b.params, &sums);
    assert_memory_equal(b.p->position, rests, sizeof rests);
    assert_true(sums.rms_step == 0 && fabs(sums.energy / before.energy - 1) < 1e-6);
    assert_true(relax_build(b.r, b.p, b.params.sigma, 0.6 * h, &e));
    relax_sweep(b.r, b.p, &b.params, &sums); /* with new lists all particles move */
    assert_true(sums.rms_step > 0);
    b.params.may_skip = false;
    relax_sweep(b.r, b.p, &b.params, &sums);
    assert_true(sums.rms_step > 0);
    tear_down(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(energies_are_returned_with_the_remaining_steps),
        cmocka_unit_test(divergent_share_is_that_of_all_pairs_within_the_lists),
        cmocka_unit_test(particles_free_to_drift_have_no_remaining_step),
        cmocka_unit_test(steps_of_displaced_particles_are_reported_separately),
        cmocka_unit_test(refreshed_lists_give_the_energies_of_new_ones),
        cmocka_unit_test(lists_that_do_not_cover_are_not_refreshed),
        cmocka_unit_test(converged_particles_are_skipped),
        cmocka_unit_test(energy_never_rises),
        cmocka_unit_test(energy_never_rises_by_guarded_steps_in_lanes),
        cmocka_unit_test(coincident_points_do_not_set_the_support),
        cmocka_unit_test(lists_stay_valid),
        cmocka_unit_test(sweeps_without_checks_converge_to_the_same_energy),
        cmocka_unit_test(opposite_surfaces_do_not_interact),
    };
    return cmocka_run_group_tests_name("relax", tests, NULL, NULL);
}
