// SPDX-License-Identifier: Apache-2.0
/* The pair kernel against the functions of the potential, pair by pair, and against differences of the
 * energy. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "sampling/packing/energy.h"
#include "sampling/packing/pair.h"
#include "shapes.h"

enum { NEIGHBOURS = 21, PADDED = 24 };

typedef struct fixture {
    _Alignas(64) double x[PADDED];
    _Alignas(64) double y[PADDED];
    _Alignas(64) double z[PADDED];
    _Alignas(64) double weight[PADDED];
    _Alignas(64) double size2[PADDED];
    pair_list list;
    vec3 at, axis1, axis2;
} fixture;

static void random_fixture(fixture *f, rng *r)
{
    for (int k = 0; k < PADDED; k++) {
        vec3 p = random_between(r, (vec3){-1, -1, -0.1}, (vec3){1, 1, 0.1});
        f->x[k] = p.x;
        f->y[k] = p.y;
        f->z[k] = p.z;
        f->weight[k] = k < NEIGHBOURS ? 0.5 + rng_uniform(r) : 0;
        f->size2[k] = 0.6 + rng_uniform(r);
    }
    f->list = (pair_list){.blocks = PADDED / PAIR_LANES,
                          .x = f->x,
                          .y = f->y,
                          .z = f->z,
                          .weight = f->weight,
                          .size2 = f->size2};
    f->at = random_between(r, (vec3){-0.1, -0.1, -0.05}, (vec3){0.1, 0.1, 0.05});
    vec3_frame(vec3_unit(random_between(r, (vec3){-0.2, -0.2, 1}, (vec3){0.2, 0.2, 1})), &f->axis1,
               &f->axis2);
}

static const double sigma = 0.8;

static void energy_is_the_sum_of_pairs(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    for (int round = 0; round < 50; round++) {
        fixture f;
        random_fixture(&f, &r);
        double sum = 0, nearest = INFINITY;
        for (int k = 0; k < NEIGHBOURS; k++) {
            double d = vec3_norm(vec3_sub(f.at, (vec3){f.x[k], f.y[k], f.z[k]}));
            double support = sqrt(f.size2[k]) * sigma;
            sum += f.weight[k] * f.size2[k] * energy_cotangent.value(d / support);
            if (d < support) nearest = fmin(nearest, d);
        }
        pair_forces forces;
        pair_forces_at(&f.list, &energy_cotangent, f.at, f.axis1, f.axis2, sigma, &forces);
        assert_close(pair_energy_at(&f.list, &energy_cotangent, f.at, sigma) / sum, 1, 1e-11);
        assert_close(forces.energy / sum, 1, 1e-11);
        assert_close(sqrt(forces.nearest2), nearest, 1e-12);
    }
}

static void forces_match_differences_of_energy(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    const double step = 1e-6;
    for (int round = 0; round < 50; round++) {
        fixture f;
        random_fixture(&f, &r);
        pair_forces p;
        pair_forces_at(&f.list, &energy_cotangent, f.at, f.axis1, f.axis2, sigma, &p);
        const vec3 axes[2] = {f.axis1, f.axis2};
        const double d[2] = {p.d1, p.d2};
        for (int k = 0; k < 2; k++) {
            double up = pair_energy_at(&f.list, &energy_cotangent, vec3_axpy(step, axes[k], f.at), sigma);
            double down = pair_energy_at(&f.list, &energy_cotangent, vec3_axpy(-step, axes[k], f.at), sigma);
            assert_close(d[k], (up - down) / (2 * step), 1e-5 * (1 + fabs(d[k])));
        }
    }
}

/* (10) without its second term, restricted to the frame, by an explicit formula. */
static void hessian_is_the_first_term_of_equation_10(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 2);
    for (int round = 0; round < 50; round++) {
        fixture f;
        random_fixture(&f, &r);
        pair_forces p;
        pair_forces_at(&f.list, &energy_cotangent, f.at, f.axis1, f.axis2, sigma, &p);
        double h11 = 0, h12 = 0, h22 = 0;
        for (int k = 0; k < NEIGHBOURS; k++) {
            vec3 d = vec3_sub(f.at, (vec3){f.x[k], f.y[k], f.z[k]});
            double length = vec3_norm(d);
            double support = sqrt(f.size2[k]) * sigma; /* size2 / support^2 is 1 / sigma^2 */
            double bend = f.weight[k] * energy_cotangent.second(length / support) / (sigma * sigma);
            double a1 = vec3_dot(d, f.axis1) / length, a2 = vec3_dot(d, f.axis2) / length;
            h11 += bend * a1 * a1;
            h12 += bend * a1 * a2;
            h22 += bend * a2 * a2;
        }
        assert_close(p.h11 / h11, 1, 1e-9);
        assert_close(p.h22 / h22, 1, 1e-9);
        assert_close(p.h12, h12, 1e-9 * (h11 + h22));
    }
}

/* The kernel that uses tables, with the table of the cotangent and with others. */
static void tables_agree_with_the_kernel_and_with_differences(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 4);
    energy_function copy = energy_cotangent; /* another address: not the vectorised kernel */
    const energy_function *const tables[] = {&copy, &energy_gaussian, &energy_electrostatic};
    const double step = 1e-6;
    for (int round = 0; round < 60; round++) {
        const energy_function *t = tables[round % 3];
        fixture f;
        random_fixture(&f, &r);
        for (int k = 0; k < NEIGHBOURS; k++) /* away from the truncation, where differences are not valid */
            if (fabs(vec3_norm(vec3_sub(f.at, (vec3){f.x[k], f.y[k], f.z[k]})) - sqrt(f.size2[k]) * sigma) <
                1e-4)
                f.weight[k] = 0;
        pair_forces p, q;
        pair_forces_at(&f.list, t, f.at, f.axis1, f.axis2, sigma, &p);
        assert_close(p.energy, pair_energy_at(&f.list, t, f.at, sigma), 1e-12 * p.energy);
        double up = pair_energy_at(&f.list, t, vec3_axpy(step, f.axis1, f.at), sigma);
        double down = pair_energy_at(&f.list, t, vec3_axpy(-step, f.axis1, f.at), sigma);
        assert_close(p.d1, (up - down) / (2 * step), 1e-4 * (1 + fabs(p.d1)));
        if (t != &copy) continue;
        pair_forces_at(&f.list, &energy_cotangent, f.at, f.axis1, f.axis2, sigma, &q);
        assert_close(p.energy, q.energy, 1e-10 * q.energy);
        assert_close(p.d2, q.d2, 1e-8 * (fabs(q.d1) + fabs(q.d2)));
        assert_close(p.h11, q.h11, 1e-8 * q.h11);
        assert_close(p.h12, q.h12, 1e-8 * (q.h11 + q.h22));
        assert_close(p.nearest2, q.nearest2, 1e-12);
    }
}

static void coincident_pair_stays_finite(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 3);
    fixture f;
    random_fixture(&f, &r);
    f.at = (vec3){f.x[0], f.y[0], f.z[0]};
    pair_forces p;
    pair_forces_at(&f.list, &energy_cotangent, f.at, f.axis1, f.axis2, sigma, &p);
    assert_true(isfinite(p.energy) && isfinite(p.d1) && isfinite(p.h11));
    assert_true(isfinite(pair_energy_at(&f.list, &energy_cotangent, f.at, sigma)));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(energy_is_the_sum_of_pairs),
        cmocka_unit_test(forces_match_differences_of_energy),
        cmocka_unit_test(hessian_is_the_first_term_of_equation_10),
        cmocka_unit_test(tables_agree_with_the_kernel_and_with_differences),
        cmocka_unit_test(coincident_pair_stays_finite),
    };
    return cmocka_run_group_tests_name("pair", tests, NULL, NULL);
}
