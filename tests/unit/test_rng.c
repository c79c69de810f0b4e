// SPDX-License-Identifier: Apache-2.0
/* Random numbers: the published generator, and independent streams. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "base/core/rng.h"
#include "close.h"

/* The first outputs of xoshiro256++ from the state 1, 2, 3, 4, by hand from its definition: rotl(s0 +
 * s3, 23) + s0. */
static void test_the_generator_is_the_published_one(void **state)
{
    (void)state;
    static const uint64_t wanted[] = {41943041, 58720359, 3588806011781223, 3591011842654386};
    rng r = {{1, 2, 3, 4}};
    for (int i = 0; i < 4; i++) assert_true(rng_next(&r) == wanted[i]);
}

static void test_seed_and_stream_determine_the_numbers(void **state)
{
    (void)state;
    for (uint64_t stream = 0; stream < 8; stream++) {
        rng a = rng_seed(5, stream), b = rng_seed(5, stream), other = rng_seed(5, stream + 1),
            seed = rng_seed(6, stream);
        for (int i = 0; i < 100; i++) {
            uint64_t x = rng_next(&a);
            assert_true(x == rng_next(&b));
            assert_true(x != rng_next(&other) && x != rng_next(&seed));
        }
    }
}

/* Mean, variance and the correlation of two streams, each within five standard deviations. */
static void test_numbers_are_uniform_and_streams_independent(void **state)
{
    (void)state;
    enum { COUNT = 1000000 };
    rng a = rng_seed(1, 0), b = rng_seed(1, 1);
    double mean = 0, variance = 0, both = 0;
    for (int i = 0; i < COUNT; i++) {
        double x = rng_uniform(&a), y = rng_uniform(&b);
        assert_true(x >= 0 && x < 1);
        mean += x / COUNT;
        variance += (x - 0.5) * (x - 0.5) / COUNT;
        both += (x - 0.5) * (y - 0.5) / COUNT;
    }
    assert_close(mean, 0.5, 5 * sqrt(1 / 12.0 / COUNT));
    assert_close(variance, 1 / 12.0, 5 * sqrt(1 / 180.0 / COUNT));
    assert_close(both, 0, 5 / 12.0 / sqrt(COUNT));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_the_generator_is_the_published_one),
        cmocka_unit_test(test_seed_and_stream_determine_the_numbers),
        cmocka_unit_test(test_numbers_are_uniform_and_streams_independent),
    };
    return cmocka_run_group_tests_name("rng", tests, NULL, NULL);
}
