// SPDX-License-Identifier: Apache-2.0
/* Half floats: all 65 536 of them, and rounding between neighbours. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>

#include "io/points/half.h"

/* By the definition: sign, five bits of exponent, ten bits of fraction. */
static double value_of(uint16_t h)
{
    int exponent = h >> 10 & 31, fraction = h & 1023;
    double size = exponent == 0    ? ldexp(fraction, -24)
                  : exponent == 31 ? (fraction ? (double)NAN : (double)INFINITY)
                                   : ldexp(1024 + fraction, exponent - 25);
    return h & 0x8000 ? -size : size;
}

static void test_each_half_is_its_float(void **state)
{
    (void)state;
    for (uint32_t h = 0; h <= 0xFFFF; h++) {
        double wanted = value_of((uint16_t)h);
        float got = half_to_float((uint16_t)h);
        if (isnan(wanted)) {
            assert_true(isnan(got) && isnan(half_to_float(half_from_float(got))));
        } else {
            assert_true(got == wanted);
            assert_int_equal(half_from_float(got), h); /* of both zeros, too */
        }
    }
}

/* The midpoint of two halves is rounded to the even one; other values to the nearest one. */
static void test_rounding_is_to_nearest_even(void **state)
{
    (void)state;
    for (uint16_t h = 0; h < 0x7BFF; h++) {
        double low = value_of(h), high = value_of((uint16_t)(h + 1));
        float middle = (float)(0.5 * (low + high));
        assert_int_equal(half_from_float(middle), h % 2 ? h + 1 : h);
        assert_int_equal(half_from_float(nextafterf(middle, 0)), h);
        assert_int_equal(half_from_float(nextafterf(middle, INFINITY)), h + 1);
        assert_int_equal(half_from_float(-middle), 0x8000 | (h % 2 ? h + 1 : h));
    }
}

static void test_values_above_the_range_become_infinite(void **state)
{
    (void)state;
    assert_int_equal(half_from_float(65504), 0x7BFF);
    assert_int_equal(half_from_float(65519.99f), 0x7BFF);
    assert_int_equal(half_from_float(65520), 0x7C00);
    assert_int_equal(half_from_float(-1e30f), 0xFC00);
    assert_int_equal(half_from_float(INFINITY), 0x7C00);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_each_half_is_its_float),
        cmocka_unit_test(test_rounding_is_to_nearest_even),
        cmocka_unit_test(test_values_above_the_range_become_infinite),
    };
    return cmocka_run_group_tests_name("half", tests, NULL, NULL);
}
