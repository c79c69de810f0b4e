// SPDX-License-Identifier: Apache-2.0
/* The potential against its definition and its derivatives against finite differences. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "close.h"
#include "sampling/packing/energy.h"
#include "spec/spec.h"

static void value_is_equation_6(void **state)
{
    (void)state;
    for (double u = 0.01; u < 1; u += 0.01) {
        double w = u * M_PI_2;
        assert_close(energy_cotangent.value(u), cos(w) / sin(w) + w - M_PI_2, 1e-12);
    }
    assert_true(energy_cotangent.value(1) == 0);
    assert_true(energy_cotangent.value(1.5) == 0);
}

static void sum_is_of_values(void **state)
{
    (void)state;
    enum { PAIRS = 5 * ENERGY_LANES };
    double u2[PAIRS], weight[PAIRS], sum = 0;
    for (int k = 0; k < PAIRS; k++) {
        double u = k == 0 ? 1e-6 : (k + 0.5) / PAIRS;
        u2[k] = u * u;
        weight[k] = k % 7; /* some are 0 */
        sum += weight[k] * energy_cotangent.value(u);
    }
    assert_close(energy_cotangent_sum(u2, weight, PAIRS), sum, 1e-11);
    for (int k = 0; k < PAIRS; k++) /* one pair at a time, in each lane */
        for (int l = 0; l < PAIRS; l++) {
            weight[l] = l == k;
            if (l == PAIRS - 1)
                assert_close(energy_cotangent_sum(u2, weight, PAIRS) / energy_cotangent.value(sqrt(u2[k])), 1,
                             u2[k] < 0.9 ? 1e-11 : 1e-6);
        }
    assert_true(energy_cotangent_sum(u2, weight, 0) == 0);
}

static void first_is_equation_7(void **state)
{
    (void)state;
    for (double u = 0.02; u < 1; u += 0.01) {
        double s = sin(u * M_PI_2);
        assert_close(energy_cotangent.first(u) / (M_PI_2 * (1 - 1 / (s * s))), 1, 1e-9);
    }
}

static const energy_function *const all[] = {&energy_cotangent, &energy_gaussian, &energy_electrostatic};
enum { ENERGIES = sizeof all / sizeof all[0] };

static void derivatives_match_differences(void **state)
{
    (void)state;
    const double step = 1e-5;
    for (int k = 0; k < ENERGIES; k++)
        for (double u = 0.05; u < 0.999; u += 0.013) {
            double first = (all[k]->value(u + step) - all[k]->value(u - step)) / (2 * step);
            double second = (all[k]->first(u + step) - all[k]->first(u - step)) / (2 * step);
            assert_close(first, all[k]->first(u), 1e-4 * (1e-3 + fabs(first)));
            assert_close(second, all[k]->second(u), 1e-4 * (1e-2 + fabs(second)));
        }
}

/* The tables for the packing whose second ring lies at the support. */
static void ideals_are_of_six_neighbours(void **state)
{
    (void)state;
    const double u = 1 / sqrt(3);
    for (int k = 0; k < ENERGIES; k++) {
        assert_close(6 * all[k]->value(u) / all[k]->ideal, 1, 1e-12);
        assert_close(-u * all[k]->first(u) / all[k]->value(u) / all[k]->ideal_slope, 1, 1e-12);
        assert_true(energy_find(all[k]->name) == all[k]);
        assert_true(all[k]->value(1) == 0 && all[k]->first(1.1) == 0 && all[k]->second(2) == 0);
    }
    assert_null(energy_find("gravity"));
}

/* Every energy that a spec can request exists in the sampler. */
static void every_word_of_a_spec_is_an_energy(void **state)
{
    (void)state;
    for (spec_energy k = 0; k < SPEC_ENERGY_COUNT; k++) assert_non_null(energy_find(spec_energy_name(k)));
    assert_int_equal(SPEC_ENERGY_COUNT, ENERGIES);
}

/* Scale invariance near zero: the force behaves as -1/r^2 (section 4). */
static void force_is_inverse_square_when_near(void **state)
{
    (void)state;
    double a = energy_cotangent.first(0.01), b = energy_cotangent.first(0.02);
    assert_close(a / b, 4, 1e-2);
}

static void all_vanish_smoothly_at_the_support(void **state)
{
    (void)state;
    double u = 1 - 1e-9;
    assert_close(energy_cotangent.value(u), 0, 1e-15);
    assert_close(energy_cotangent.first(u), 0, 1e-15);
    assert_close(energy_cotangent.second(u), 0, 1e-8);
}

static void ideal_is_the_hexagonal_packing(void **state)
{
    (void)state;
    double sum = 0, slope = 0;
    for (int i = -5; i <= 5; i++)
        for (int j = -5; j <= 5; j++) {
            double u = sqrt((double)(i * i + i * j + j * j)) / sqrt(3);
            if (u == 0) continue;
            sum += energy_cotangent.value(u);
            slope -= u * energy_cotangent.first(u);
        }
    assert_close(sum, energy_cotangent.ideal, 1e-12);
    assert_close(sum, 0.710825908, 1e-9);
    assert_close(slope / sum, energy_cotangent.ideal_slope, 1e-12);
}

static void series_is_w_cot_w(void **state)
{
    (void)state;
    for (double w = 0.001; w <= M_PI_2; w += 0.001) {
        double p = 0;
        for (int k = ENERGY_COT_TERMS - 1; k >= 0; k--) p = p * w * w + energy_cot_polynomial[k];
        assert_close(p, w / tan(w), 1e-13);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(value_is_equation_6),
        cmocka_unit_test(sum_is_of_values),
        cmocka_unit_test(first_is_equation_7),
        cmocka_unit_test(derivatives_match_differences),
        cmocka_unit_test(ideals_are_of_six_neighbours),
        cmocka_unit_test(every_word_of_a_spec_is_an_energy),
        cmocka_unit_test(force_is_inverse_square_when_near),
        cmocka_unit_test(all_vanish_smoothly_at_the_support),
        cmocka_unit_test(ideal_is_the_hexagonal_packing),
        cmocka_unit_test(series_is_w_cot_w),
    };
    return cmocka_run_group_tests_name("energy", tests, NULL, NULL);
}
