// SPDX-License-Identifier: Apache-2.0
/* The kernel in single precision against the one in double, whatever the instruction set. */
#include <fenv.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "sampling/packing/fast_kernel.h"
#include "sampling/packing/pair.h"
#include "shapes.h"

enum { MOST = 40, LANES = FAST_KERNEL_LANES };

static const double sigma = 0.9, unit = 0x1p-24;

/* Particles near the origin, each with its own neighbours, in the layout of both kernels. */
typedef struct fixture {
    neighbours_place place[LANES * MOST];
    vec3 normal[LANES * MOST]; /* of the neighbours, arbitrary; for tests with weighted pairs */
    fast_kernel_factors single[LANES * MOST]; /* with amplitudes of .25 to 4 */
    uint32_t list[LANES][MOST];
    fast_kernel_particles particles;
    fast_kernel_params params;
} fixture;

static neighbours_place random_place(rng *r, vec3 half)
{
    vec3 x = random_between(r, vec3_scale(half, -1), half);
    return (neighbours_place){(int32_t)(x.x / unit), (int32_t)(x.y / unit), (int32_t)(x.z / unit),
                              (float)(0.7 + 0.6 * rng_uniform(r))};
}

static float random_amplitude(rng *r)
{
    return (float)pow(4, 2 * rng_uniform(r) - 1);
}

/* Sets the factors of pairs: each choice once in four rounds. */
static void choose_factors(fixture *f, int round)
{
    f->params.factors = f->single;
    f->params.has_facing = round % 2 == 1;
    f->params.has_amplitudes = round / 2 % 2 == 1;
}

/* At most MOST neighbours each, within and beyond the reach. */
static void random_fixture(fixture *f, rng *r)
{
    fast_kernel_particles *p = &f->particles;
    memset(f, 0, sizeof *f);
    f->params =
        (fast_kernel_params){.unit = unit, .support = sigma, .omega = 1.2, .longest = 0.2, .farthest = 0.05};
    for (uint32_t l = 0; l < LANES; l++) {
        neighbours_place own = random_place(r, (vec3){0.05, 0.05, 0.01});
        vec3 n = vec3_unit(random_between(r, (vec3){-0.2, -0.2, 1}, (vec3){0.2, 0.2, 1}));
        if (rng_uniform(r) < 0.5) n = vec3_scale(n, -1);
        for (uint32_t k = 0; k < MOST; k++) {
            f->list[l][k] = l * MOST + k * 7 % MOST; /* any order */
            f->place[l * MOST + k] = random_place(r, (vec3){1, 1, 0.1});
            const vec3 other = vec3_unit(random_between(r, (vec3){-1, -1, -1}, (vec3){1, 1, 1}));
            f->normal[l * MOST + k] = other;
            f->single[l * MOST + k] =
                (fast_kernel_factors){(float)other.x, (float)other.y, (float)other.z, random_amplitude(r)};
        }
        p->list[l] = f->list[l];
        p->count[l] = (uint32_t)(rng_uniform(r) * (MOST + 1));
        p->x[l] = own.x;
        p->y[l] = own.y;
        p->z[l] = own.z;
        p->size[l] = own.size;
        p->amplitude[l] = random_amplitude(r);
        p->allowed_step[l] = (float)(0.1 * rng_uniform(r));
        p->position.x[l] = own.x * unit;
        p->position.y[l] = own.y * unit;
        p->position.z[l] = own.z * unit;
        p->normal.x[l] = n.x;
        p->normal.y[l] = n.y;
        p->normal.z[l] = n.z;
    }
}

static vec3 lane_of(const vec3_lanes *v, size_t lane)
{
    return (vec3){v->x[lane], v->y[lane], v->z[lane]};
}

static void sum_wide(const fixture *f, const fast_kernel_forces *frames, size_t l, pair_forces *out)
{
    const fast_kernel_particles *p = &f->particles;
    double column[9][MOST];
    for (size_t k = 0; k < MOST; k++) {
        const neighbours_place *q = &f->place[f->list[l][k]];
        const vec3 *n = &f->normal[f->list[l][k]];
        double size = 0.5 * (1 + (double)q->size / (double)p->size[l]), weight = k < p->count[l];
        if (f->params.has_amplitudes)
            weight *= 0.5 * ((double)p->amplitude[l] + (double)f->single[f->list[l][k]].amplitude);
        double entry[9] = {q->x * unit, q->y * unit, q->z * unit, weight, size * size,
                           n->x,        n->y,        n->z,        weight};
        for (int c = 0; c < 9; c++) column[c][k] = entry[c];
    }
    pair_list pairs = {.blocks = MOST / PAIR_LANES,
                       .x = column[0],
                       .y = column[1],
                       .z = column[2],
                       .weight = column[3],
                       .size2 = column[4],
                       .nx = column[5],
                       .ny = column[6],
                       .nz = column[7],
                       .amplitude = column[8]};
    if (f->params.has_facing) pair_weigh(&pairs, lane_of(&p->normal, l));
    vec3 axis1 = {frames->axis1[0][l], frames->axis1[1][l], frames->axis1[2][l]};
    vec3 axis2 = {frames->axis2[0][l], frames->axis2[1][l], frames->axis2[2][l]};
    pair_forces_at(&pairs, &energy_cotangent, lane_of(&p->position, l), axis1, axis2,
                   sigma * (double)p->size[l], out);
}

/* Equals the pair kernel to single precision; the terms have the magnitude of the stiffest pair. */
static void sums_are_those_in_double(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    for (int round = 0; round < 20; round++) {
        fixture f;
        fast_kernel_forces single;
        random_fixture(&f, &r);
        choose_factors(&f, round);
        fast_kernel_for(isa_best())->forces(f.place, &f.particles, &f.params, &single);
        for (size_t l = 0; l < LANES; l++) {
            pair_forces wide;
            sum_wide(&f, &single, l, &wide);
            double stiff = (wide.h11 + wide.h22) * unit * unit, slope = sqrt(stiff * wide.energy);
            /* the error of w cot w, which is not relative: pairs at the support have almost no energy */
            const double least = 4e-6 * unit * unit;
            assert_close((double)single.energy[l], wide.energy,
                         1e-5 * wide.energy + 1e-6 * f.particles.count[l]);
            assert_close((double)single.d1[l], wide.d1 * unit, 1e-5 * slope + 1e-12);
            assert_close((double)single.d2[l], wide.d2 * unit, 1e-5 * slope + 1e-12);
            assert_close((double)single.h11[l], wide.h11 * unit * unit, 1e-5 * stiff + least);
            assert_close((double)single.h12[l], wide.h12 * unit * unit, 1e-5 * stiff + least);
            assert_close((double)single.h22[l], wide.h22 * unit * unit, 1e-5 * stiff + least);
            if (isinf(wide.nearest2))
                assert_true(isinf(single.nearest2[l]));
            else
                assert_close((double)single.nearest2[l], wide.nearest2 / unit / unit,
                             1e-5 * wide.nearest2 / unit / unit);
        }
    }
}

/* After the end of a particle's list another list follows, which may have entries close to the particle.
 * These must not produce denormal numbers, which some processors compute slowly. */
static void entries_after_the_end_of_a_list_are_not_computed(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 5);
    for (int which = 0; which < ISA_COUNT; which++) {
        if (!isa_available((isa)which)) continue;
        const fast_kernel *kernel = fast_kernel_for((isa)which);
        fixture f;
        fast_kernel_forces forces;
        float energy[LANES];
        random_fixture(&f, &r);
        for (size_t l = 0; l < LANES; l++)
            for (uint32_t k = f.particles.count[l]; k < MOST; k++)
                f.place[f.list[l][k]] = (neighbours_place){f.particles.x[l], f.particles.y[l],
                                                           f.particles.z[l], f.particles.size[l]};
        choose_factors(&f, which);
        feclearexcept(FE_ALL_EXCEPT);
        kernel->forces(f.place, &f.particles, &f.params, &forces);
        kernel->energy(f.place, &f.particles, &f.params, LANES, energy);
        assert_false(fetestexcept(FE_UNDERFLOW));
    }
}

/* The derivative of the energy by a rotation of the particle's own normal, against differences. */
static void rotation_derivative_matches_differences(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 4);
    const double step = 1e-3;
    double greatest = 0;
    for (int round = 0; round < 10; round++) {
        fixture f;
        fast_kernel_forces forces;
        float energy[2][LANES];
        random_fixture(&f, &r);
        choose_factors(&f, 1 + 2 * round); /* facing weights in all rounds */
        fast_kernel_for(isa_best())->forces(f.place, &f.particles, &f.params, &forces);
        const fast_kernel_particles own = f.particles;
        const double scale = f.params.has_amplitudes ? 4 : 1; /* of energies */
        for (int side = 0; side < 2; side++) {
            for (size_t l = 0; l < LANES; l++)
                f.particles.normal.x[l] = own.normal.x[l] + (side - 0.5) * step;
            fast_kernel_for(isa_best())->energy(f.place, &f.particles, &f.params, LANES, energy[side]);
        }
        for (size_t l = 0; l < LANES; l++) {
            double slope = ((double)energy[1][l] - (double)energy[0][l]) / step;
            if (sqrt((double)forces.nearest2[l]) * unit < 0.1 * sigma)
                continue; /* the potential is truncated there */
            assert_close((double)forces.turning[0][l], slope, 0.1 * scale + 0.02 * fabs(slope));
            greatest = fmax(greatest, fabs(slope));
        }
    }
    assert_true(greatest > 1);
}

/* The derivatives along the axes of the frame, against differences of the energy. */
static void forces_with_amplitudes_match_differences(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 6);
    const int step = 1 << 15; /* in units: 0.002 of the support */
    int compared = 0;
    for (int round = 0; round < 20; round++) {
        fixture f;
        fast_kernel_forces forces;
        float energy[2][2][LANES];
        random_fixture(&f, &r);
        choose_factors(&f, 2);
        for (size_t l = 0; l < LANES; l++) /* the frame is that of the axes */
            vec3_lanes_put(&f.particles.normal, (int)l, (vec3){0, 0, 1});
        const fast_kernel *kernel = fast_kernel_for(isa_best());
        kernel->forces(f.place, &f.particles, &f.params, &forces);
        const fast_kernel_particles own = f.particles;
        for (int axis = 0; axis < 2; axis++)
            for (int side = 0; side < 2; side++) {
                f.particles = own;
                for (size_t l = 0; l < LANES; l++)
                    (axis == 0 ? f.particles.x : f.particles.y)[l] += (2 * side - 1) * step;
                kernel->energy(f.place, &f.particles, &f.params, LANES, energy[axis][side]);
            }
        for (size_t l = 0; l < LANES; l++) {
            /* the energy is steep near a pair, and pairs at the support have almost no energy */
            if (sqrt((double)forces.nearest2[l]) * unit < 0.2 * sigma || forces.energy[l] < 0.1f) continue;
            const double slope[2] = {((double)energy[0][1][l] - (double)energy[0][0][l]) / (2 * step),
                                     ((double)energy[1][1][l] - (double)energy[1][0][l]) / (2 * step)},
                         stiff = sqrt((double)(forces.h11[l] + forces.h22[l]) * (double)forces.energy[l]);
            for (int axis = 0; axis < 2; axis++) {
                const double along = (double)(axis == 0 ? forces.axis1 : forces.axis2)[axis][l],
                             found = (double)(axis == 0 ? forces.d1 : forces.d2)[l];
                assert_close(fabs(along), 1, 1e-6);
                /* the second term: rounding of the energies in single precision */
                assert_close(found, along * slope[axis],
                             0.01 * stiff + 1e-6 * (double)forces.energy[l] / step);
            }
            compared++;
        }
    }
    assert_true(compared > 50);
}

/* An amplitude of 1 for all points changes no bit. */
static void amplitudes_of_1_change_nothing(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 7);
    for (int round = 0; round < 4; round++) {
        fixture f;
        fast_kernel_forces without, with;
        random_fixture(&f, &r);
        choose_factors(&f, round % 2);
        for (size_t k = 0; k < LANES * MOST; k++) f.single[k].amplitude = 1;
        for (size_t l = 0; l < LANES; l++) f.particles.amplitude[l] = 1;
        fast_kernel_for(isa_best())->forces(f.place, &f.particles, &f.params, &without);
        f.params.has_amplitudes = true;
        fast_kernel_for(isa_best())->forces(f.place, &f.particles, &f.params, &with);
        assert_memory_equal(&with, &without, sizeof with);
    }
}

static void frames_are_tangent(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    fixture f;
    fast_kernel_forces out;
    random_fixture(&f, &r);
    fast_kernel_for(isa_best())->forces(f.place, &f.particles, &f.params, &out);
    for (size_t l = 0; l < LANES; l++) {
        vec3 n = lane_of(&f.particles.normal, l);
        vec3 u = {out.axis1[0][l], out.axis1[1][l], out.axis1[2][l]},
             v = {out.axis2[0][l], out.axis2[1][l], out.axis2[2][l]};
        assert_close(vec3_norm(vec3_sub(vec3_cross(u, v), n)), 0, 1e-6);
        assert_close(vec3_dot(u, v), 0, 1e-6);
        assert_close(vec3_norm(u), 1, 1e-6);
    }
}

/* A fast step over the plane z = 0.001, whose field has the gradient 2. */
static void go(const fixture *f, const fast_kernel *k, fast_kernel_forces *forces, fast_kernel_step *step)
{
    memset(forces, 0, sizeof *forces);
    memset(step, 0, sizeof *step);
    k->forces(f->place, &f->particles, &f->params, forces);
    k->tangent_step(&f->particles, forces, &f->params, step);
    for (size_t l = 0; l < LANES; l++) {
        step->value[l] = 2 * (step->end.z[l] - 0.001);
        step->gradient.z[l] = 2;
    }
    k->project(&f->particles, &f->params, step);
}

static void a_fast_step_ends_on_the_surface_within_its_limit(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 2);
    int ended_well = 0, refused = 0;
    for (int round = 0; round < 50; round++) {
        fixture f;
        fast_kernel_forces forces;
        fast_kernel_step step;
        random_fixture(&f, &r);
        if (round % 2 == 0) f.params.longest = 0.02;
        go(&f, fast_kernel_for(isa_best()), &forces, &step);
        for (size_t l = 0; l < LANES; l++) {
            if (!step.is_valid[l]) {
                refused++;
                continue;
            }
            double length = vec3_norm(vec3_sub(lane_of(&step.end, l), lane_of(&f.particles.position, l)));
            assert_close(step.end.z[l], 0.001, 1e-15);
            assert_close(step.length[l], length, 1e-12);
            assert_true(length <= (double)f.particles.allowed_step[l]);
            assert_close(vec3_norm(vec3_sub(lane_of(&step.gradient, l), (vec3){0, 0, 1})), 0, 1e-12);
            ended_well++;
        }
    }
    assert_true(ended_well > 100);
    assert_true(refused > 100);
}

/* For any instruction set, any lane, and any contents of the other lanes. */
static void a_particle_always_gets_the_same_bits(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 3);
    int compared = 0;
    for (int round = 0; round < 100; round++) {
        fixture f;
        fast_kernel_forces portable, other;
        fast_kernel_step step, other_step;
        float energy[LANES], half[LANES];
        random_fixture(&f, &r);
        choose_factors(&f, round);
        go(&f, fast_kernel_for(ISA_PORTABLE), &portable, &step);
        for (isa which = ISA_PORTABLE + 1; which < ISA_COUNT; which++) {
            if (!isa_available(which)) continue;
            go(&f, fast_kernel_for(which), &other, &other_step);
            assert_memory_equal(&portable, &other, sizeof other);
            assert_memory_equal(&step, &other_step, sizeof step);
            fast_kernel_for(which)->energy(f.place, &f.particles, &f.params, LANES, energy);
            assert_memory_equal(energy, portable.energy, sizeof energy);
            fast_kernel_for(which)->energy(f.place, &f.particles, &f.params, LANES / 2, half);
            assert_memory_equal(half, portable.energy, sizeof half / 2);
            compared++;
        }
        fast_kernel_particles *p = &f.particles;
        p->list[5] = p->list[3]; /* lane 3 alone, in lane 5 */
        p->x[5] = p->x[3];
        p->y[5] = p->y[3];
        p->z[5] = p->z[3];
        p->size[5] = p->size[3];
        p->normal.x[5] = p->normal.x[3];
        p->normal.y[5] = p->normal.y[3];
        p->normal.z[5] = p->normal.z[3];
        p->count[5] = p->count[3];
        p->amplitude[5] = p->amplitude[3];
        for (size_t l = 0; l < LANES; l++)
            if (l != 5) p->count[l] = 0;
        fast_kernel_for(ISA_PORTABLE)->forces(f.place, p, &f.params, &other);
        assert_memory_equal(&other.energy[5], &portable.energy[3], sizeof(float));
        assert_memory_equal(&other.d1[5], &portable.d1[3], sizeof(float));
        assert_memory_equal(&other.h22[5], &portable.h22[3], sizeof(float));
    }
    print_message("# %d comparisons of instruction sets on this machine\n", compared);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sums_are_those_in_double),
        cmocka_unit_test(entries_after_the_end_of_a_list_are_not_computed),
        cmocka_unit_test(rotation_derivative_matches_differences),
        cmocka_unit_test(forces_with_amplitudes_match_differences),
        cmocka_unit_test(amplitudes_of_1_change_nothing),
        cmocka_unit_test(frames_are_tangent),
        cmocka_unit_test(a_fast_step_ends_on_the_surface_within_its_limit),
        cmocka_unit_test(a_particle_always_gets_the_same_bits),
    };
    return cmocka_run_group_tests_name("kernel", tests, NULL, NULL);
}
