// SPDX-License-Identifier: Apache-2.0
/* Elementary functions: their errors against the C library's extended precision, exact results, special values, and the same bits
 * for every instruction set. The module is compiled into this file, so that its functions can be inlined for each set. */
#include <inttypes.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#pragma GCC visibility push(hidden) /* a visible function could be replaced, and is not inlined */
#include "base/core/elementary.c"
#pragma GCC visibility pop
#include "base/core/rng.h"

/* Name; result and reference for x and y; exponents of two of the magnitudes of x and y; interval of x and y; largest error in units
 * in the last place. Functions of one argument have the empty interval of y. */
#define FUNCTIONS(F)                                                                                 \
    F(sin, elementary_sin(x), sinl(x), -60, 20, 0, 0, -20, 20, 0, 0, 1.5)                            \
    F(cos, elementary_cos(x), cosl(x), -60, 20, 0, 0, -20, 20, 0, 0, 1.5)                            \
    F(sine_of_two, elementary_sincos(x).sin, sinl(x), -60, 20, 0, 0, -20, 20, 0, 0, 1.5)             \
    F(cosine_of_two, elementary_sincos(x).cos, cosl(x), -60, 20, 0, 0, -20, 20, 0, 0, 1.5)           \
    F(tan, elementary_tan(x), tanl(x), -60, 20, 0, 0, -20, 20, 0, 0, 3)                              \
    F(acos, elementary_acos(x), acosl(x), -60, 0, 0, 0, -1, 1, 0, 0, 3)                              \
    F(atan, elementary_atan(x), atanl(x), -1074, 1023, 0, 0, -4, 4, 0, 0, 3)                         \
    F(atan2, elementary_atan2(x, y), atan2l(x, y), -1074, 1023, -1074, 1023, -1, 1, -1, 1, 3)        \
    F(exp, elementary_exp(x), expl(x), -60, 9, 0, 0, -746, 710, 0, 0, 1.5)                           \
    F(exp2, elementary_exp2(x), exp2l(x), -60, 10, 0, 0, -1076, 1025, 0, 0, 1.5)                     \
    F(log, elementary_log(fabs(x)), logl(fabsl(x)), -1074, 1023, 0, 0, 0, 2, 0, 0, 1.5)              \
    F(log2, elementary_log2(fabs(x)), log2l(fabsl(x)), -1074, 1023, 0, 0, 0, 2, 0, 0, 0.6)           \
    F(log10, elementary_log10(fabs(x)), log10l(fabsl(x)), -1074, 1023, 0, 0, 0, 2, 0, 0, 0.6)        \
    F(log1p, elementary_log1p(x), log1pl(x), -60, -1, 0, 0, -1, 10, 0, 0, 2)                         \
    F(pow, elementary_pow(fabs(x), y), powl(fabsl(x), y), -1074, 1023, -60, 7, 0, 2, -100, 100, 1.5) \
    F(cbrt, elementary_cbrt(x), cbrtl(x), -1074, 1023, 0, 0, -8, 8, 0, 0, 1.5)                       \
    F(hypot, elementary_hypot(x, y), hypotl(x, y), -1074, 1023, -1074, 1023, -1, 1, -1, 1, 2)        \
    F(tanh, elementary_tanh(x), tanhl(x), -1074, 6, 0, 0, -2, 2, 0, 0, 3)

#define IDENTIFIER(name, ...) FUNCTION_##name,
enum { FUNCTIONS(IDENTIFIER) FUNCTION_COUNT, VALUES = 100000 };

typedef struct function {
    const char *name;
    int x_exponent[2], y_exponent[2];
    double x_interval[2], y_interval[2], most;
} function;
#define ROW(name, of, reference, x0, x1, y0, y1, a0, a1, b0, b1, most) \
    {#name, {x0, x1}, {y0, y1}, {a0, a1}, {b0, b1}, most},
static const function functions[] = {FUNCTIONS(ROW)};

#define CASE_VALUE(name, of, ...) \
    case FUNCTION_##name:         \
        return of;
#define CASE_REFERENCE(name, of, reference, ...) \
    case FUNCTION_##name:                        \
        return reference;

ISA_INLINE double value_of(int which, double x, double y)
{
    switch (which) {
        FUNCTIONS(CASE_VALUE)
    }
    return NAN;
}

static long double reference_of(int which, long double x, long double y)
{
    switch (which) {
        FUNCTIONS(CASE_REFERENCE)
    }
    return NAN;
}

static uint64_t seed(void)
{
    const char *given = getenv("HEXAD_TEST_SEED");
    const uint64_t value = given ? strtoull(given, NULL, 0) : 1;
    print_message("HEXAD_TEST_SEED=%" PRIu64 "\n", value);
    return value;
}

/* Every other number is of any magnitude, the others are in the interval. Exact operations only. */
static double argument(rng *r, int k, const int exponent[2], const double interval[2])
{
    const double u = rng_uniform(r), v = rng_uniform(r);
    if (k % 2) return interval[0] + (interval[1] - interval[0]) * u;
    const double magnitude = ldexp(1 + v, exponent[0] + (int)floor(u * (exponent[1] - exponent[0])));
    return rng_next(r) & 1 ? -magnitude : magnitude;
}

/* In units in the last place of the nearest double. */
static double error_of(double value, long double exact)
{
    if (isnan(value) || isnan(exact)) return isnan(value) && isnan(exact) ? 0 : INFINITY;
    if (value == (double)exact) return (double)exact == exact || isinf(value) ? 0 : 0.5;
    int exponent;
    frexp((double)exact, &exponent);
    const double unit = ldexp(1, (exponent < -1021 ? -1021 : exponent) - 53);
    return (double)fabsl((value - exact) / unit);
}

static void errors_are_below_their_bounds(void **state)
{
    (void)state;
    const uint64_t from = seed();
    for (int f = 0; f < FUNCTION_COUNT; f++) {
        const function *of = &functions[f];
        rng r = rng_seed(from, (uint64_t)f);
        double worst = 0, x_worst = 0, y_worst = 0;
        for (int k = 0; k < VALUES; k++) {
            const double x = argument(&r, k, of->x_exponent, of->x_interval);
            const double y = argument(&r, k, of->y_exponent, of->y_interval);
            const double error = error_of(value_of(f, x, y), reference_of(f, x, y));
            if (error > worst) worst = error, x_worst = x, y_worst = y;
        }
        print_message("%-14s %.3f at %a %a\n", of->name, worst, x_worst, y_worst);
        if (!(worst <= of->most)) fail_msg("%s: error %g, at most %g", of->name, worst, of->most);
    }
}

/* The doubles next to multiples of pi / 2 leave the smallest rests. */
static void rests_of_angles_are_exact(void **state)
{
    (void)state;
    for (int n = 1; n < 1000000; n += n < 1000 ? 1 : 997) {
        const double angle = n * (M_PI / 2);
        assert_true(error_of(elementary_sin(angle), sinl(angle)) <= 1);
        assert_true(error_of(elementary_cos(angle), cosl(angle)) <= 1);
    }
}

static void larger_angles_have_the_error_of_their_own_rounding(void **state)
{
    (void)state;
    rng r = rng_seed(seed(), 0);
    for (int k = 0; k < 10000; k++) {
        const double angle = ELEMENTARY_ANGLE_MOST * ldexp(1 + rng_uniform(&r), k % 30);
        const double most = 0x1p-53 * angle + 0x1p-52;
        assert_true(fabsl(elementary_sin(angle) - sinl(angle)) <= most);
        assert_true(fabsl(elementary_cos(angle) - cosl(angle)) <= most);
    }
    assert_true(fabs(elementary_sin(0x1.fffffffffffffp1023)) <= 1);
}

static void results_that_are_doubles_are_exact(void **state)
{
    (void)state;
    for (int n = 0; n <= 22; n++) {
        char text[16];
        snprintf(text, sizeof text, "1e%d", n);
        assert_true(elementary_pow(10, n) == strtod(text, NULL));
        assert_true(elementary_log10(strtod(text, NULL)) == n);
    }
    for (int n = -1074; n < 1024; n++) {
        assert_true(elementary_exp2(n) == ldexp(1, n));
        assert_true(elementary_pow(2, n) == ldexp(1, n));
        assert_true(elementary_log2(ldexp(1, n)) == n);
    }
    for (int64_t n = 0; n < 200000; n++) {
        assert_true(elementary_cbrt((double)(n * n * n)) == (double)n);
        assert_true(elementary_pow((double)(n * n), 0.5) == (double)n);
    }
    assert_true(elementary_hypot(3, 4) == 5 && elementary_exp(0) == 1 && elementary_acos(1) == 0);
    assert_true(elementary_atan2(0, -1) == M_PI && elementary_atan2(1, 1) == M_PI_4);
}

/* Zeros, infinities, NaN and signs are those of the C library. */
static void special_values_are_those_of_the_standard(void **state)
{
    (void)state;
    static const double special[] = {0.0,
                                     -0.0,
                                     1,
                                     -1,
                                     0.5,
                                     -0.5,
                                     2,
                                     -2,
                                     3,
                                     -3,
                                     2.5,
                                     -2.5,
                                     0x1p-1074,
                                     -0x1p-1074,
                                     1e300,
                                     -1e300,
                                     0x1.fffffffffffffp1023,
                                     -0x1.fffffffffffffp1023,
                                     INFINITY,
                                     -INFINITY,
                                     NAN};
    enum { SPECIAL = sizeof special / sizeof *special };
    for (int f = 0; f < FUNCTION_COUNT; f++)
        for (int k = 0; k < SPECIAL * SPECIAL; k++) {
            const double x = special[k % SPECIAL], y = special[k / SPECIAL], value = value_of(f, x, y),
                         wanted = (double)reference_of(f, x, y);
            const bool is_angle = f <= FUNCTION_tan,
                       large = is_angle && isfinite(x) && fabs(x) > ELEMENTARY_ANGLE_MOST;
            if (large || (isnan(value) && isnan(wanted))) continue;
            if (!(fabs(value - wanted) <= 1e-15 * fabs(wanted) || value == wanted) ||
                signbit(value) != signbit(wanted))
                fail_msg("%s of %g, %g: %g, not %g", functions[f].name, x, y, value, wanted);
        }
    assert_true(elementary_pow(-2, 3) == -8 && isnan(elementary_pow(-2, 0.5)) &&
                elementary_pow(-INFINITY, -3) == 0);
}

/* FNV-1a of the bits of a function's values. A test that knows the hashes finds another compiler that rounds otherwise. */
#define HASHES_FOR(set, attribute)                                                                  \
    attribute __attribute__((flatten)) static void hash_##set(uint64_t hash[FUNCTION_COUNT])        \
    {                                                                                               \
        for (int f = 0; f < FUNCTION_COUNT; f++) {                                                  \
            rng r = rng_seed(1, (uint64_t)f);                                                       \
            hash[f] = 0xcbf29ce484222325;                                                           \
            for (int k = 0; k < VALUES; k++) {                                                      \
                const double x = argument(&r, k, functions[f].x_exponent, functions[f].x_interval); \
                const double y = argument(&r, k, functions[f].y_exponent, functions[f].y_interval); \
                const double value = value_of(f, x, y);                                             \
                hash[f] = (hash[f] ^ bits_of(isnan(value) ? 0 : value)) * 0x100000001b3;            \
            }                                                                                       \
        }                                                                                           \
    }
HASHES_FOR(portable, )
#ifdef __x86_64__
HASHES_FOR(avx2, __attribute__((target("avx2,fma"))))
HASHES_FOR(avx512, __attribute__((target("avx512f,avx512dq,avx512vl,fma,prefer-vector-width=512"))))
#else
#define hash_avx2 hash_portable
#define hash_avx512 hash_portable
#endif

static void bits_do_not_depend_on_the_instruction_set(void **state)
{
    (void)state;
    static const uint64_t known[FUNCTION_COUNT] = {
        [FUNCTION_sin] = 0x8d5d0b1e4f525e65,         [FUNCTION_cos] = 0x124593e85e1cb156,
        [FUNCTION_sine_of_two] = 0xd597b5ef17ecc97a, [FUNCTION_cosine_of_two] = 0xed7a09ecd9d25cfb,
        [FUNCTION_tan] = 0x48fff57a9f9e8a73,         [FUNCTION_acos] = 0xc67a7b73f25e97d0,
        [FUNCTION_atan] = 0x1031bdcbbd88267d,        [FUNCTION_atan2] = 0x3958d6b376b75e3b,
        [FUNCTION_exp] = 0x05f1a757b56d0337,         [FUNCTION_exp2] = 0xcd092c651efd86d8,
        [FUNCTION_log] = 0x6d154bfd47e01648,         [FUNCTION_log2] = 0x9b7a6aef5e728551,
        [FUNCTION_log10] = 0x1dbee0a1ff646eb2,       [FUNCTION_log1p] = 0xd352254867bcd557,
        [FUNCTION_pow] = 0xdfb6b6b6b7ef0a5a,         [FUNCTION_cbrt] = 0x3ae12dbd7977dc22,
        [FUNCTION_hypot] = 0x72e33c7af9a5a8b7,       [FUNCTION_tanh] = 0xade52844b7529846};
    void (*const version[ISA_COUNT])(uint64_t *) = {hash_portable, hash_avx2, hash_avx512};
    bool same = true;
    for (int set = 0; set < ISA_COUNT; set++) {
        if (!isa_available((isa)set)) continue;
        uint64_t hash[FUNCTION_COUNT];
        version[set](hash);
        for (int f = 0; f < FUNCTION_COUNT; f++) {
            if (hash[f] == known[f]) continue;
            print_error("%s for %s: hash 0x%016" PRIx64 "\n", functions[f].name, isa_name((isa)set), hash[f]);
            same = false;
        }
    }
    assert_true(same);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(errors_are_below_their_bounds),
        cmocka_unit_test(rests_of_angles_are_exact),
        cmocka_unit_test(larger_angles_have_the_error_of_their_own_rounding),
        cmocka_unit_test(results_that_are_doubles_are_exact),
        cmocka_unit_test(special_values_are_those_of_the_standard),
        cmocka_unit_test(bits_do_not_depend_on_the_instruction_set),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
