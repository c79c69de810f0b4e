// SPDX-License-Identifier: Apache-2.0
#include "base/core/elementary.h"

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "base/core/isa.h"

/* tools/polynomials.py prints these constants. A number that is needed to more than 53 bits is the sum of an array. */
static const double HALF_PI[] = {0x1.921fb54400000p+0, 0x1.0b4611a600000p-34, 0x1.3198a2e000000p-69,
                                 0x1.b839a252049c1p-104};
static const double LOG_2[] = {0x1.62e42fefa3800p-1, 0x1.ef35793c76730p-45};
static const double OVER_LOG_2[] = {0x1.71547652b82fep+0, 0x1.777d0ffda0d24p-56};
static const double OVER_LOG_10[] = {0x1.bcb7b1526e50ep-2, 0x1.95355baaafad3p-57};
static const double THIRD[] = {0x1.5555555555555p-2, 0x1.5555555555555p-56};
/* (sin(sqrt(u)) / sqrt(u) - 1) / u, 0 to 0.6169: error 2.0e-17 */
static const double SINE[] = {-0x1.5555555555555p-3, 0x1.1111111110bb2p-7,   -0x1.a01a019e83aaep-13,
                              0x1.71de37968a100p-19, -0x1.ae600b02b6262p-26, 0x1.5e0b19f8b1451p-33};
/* (cos(sqrt(u)) - 1 + u / 2) / u^2, 0 to 0.6169: error 1.3e-18 */
static const double COSINE[] = {0x1.5555555555555p-5,   -0x1.6c16c16c16967p-10, 0x1.a01a019f4eb01p-16,
                                -0x1.27e4fa17da09ep-22, 0x1.1eeb68e93b64cp-29,  -0x1.907da367a37cbp-37};
/* (exp(r) - 1 - r) / r^2, -0.3466 to 0.3466: error 4.4e-19 */
static const double EXPONENTIAL[] = {0x1.0000000000000p-1,  0x1.5555555555557p-3,  0x1.5555555555556p-5,
                                     0x1.11111111100dfp-7,  0x1.6c16c16c162d6p-10, 0x1.a01a01abe62ddp-13,
                                     0x1.a01a01a6d7808p-16, 0x1.71de02375656cp-19, 0x1.27e4db67b4303p-22,
                                     0x1.af4ddd84882fep-26, 0x1.1f72fc730b4ffp-29};
/* (atanh(sqrt(z)) / sqrt(z) - 1 - z / 3) / z^2, 0 to 0.02944: error 1.1e-20 */
static const double LOGARITHM[] = {0x1.999999999999ap-3, 0x1.2492492492521p-3, 0x1.c71c71c6eaa8dp-4,
                                   0x1.745d177a8f200p-4, 0x1.3b1395d4f9e5fp-4, 0x1.1118c74823a2ep-4,
                                   0x1.df7ce9a6bcccbp-5, 0x1.e02d197c00c78p-5};
/* (atan(sqrt(z)) / sqrt(z) - 1) / z, 0 to 0.25: error 4.6e-18 */
static const double ARCTANGENT[] = {-0x1.5555555555555p-2, 0x1.99999999998e1p-3,  -0x1.2492492488296p-3,
                                    0x1.c71c71c01b24cp-4,  -0x1.745d16026efd7p-4, 0x1.3b138e6372dcap-4,
                                    -0x1.110ea50256abfp-4, 0x1.e1a7b2562efc5p-5,  -0x1.ad44da04adea3p-5,
                                    0x1.7b20b751c966ap-5,  -0x1.37d750492dd9bp-5, 0x1.99b4e0c058248p-6,
                                    -0x1.2dfbaab9786efp-7};
#define POLYNOMIAL(of, x) polynomial(sizeof(of) / sizeof *(of), of, x)

#define ROUNDING 0x1.8p52        /* added to a smaller number than 2^51, leaves an integer in the last bits */
#define SPLITTING 0x1.0000002p27 /* 2^27 + 1: cuts a double into two of 26 bits */
#define SQRT_HALF 0x1.6a09e667f3bcdp-1

/* An unevaluated sum; low is at most some units in the last place of high. */
typedef struct double_double {
    double high, low;
} double_double;

ISA_INLINE uint64_t bits_of(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

ISA_INLINE double of_bits(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* 2^n for n from -1022 to 1023. */
ISA_INLINE double power_of_two(int64_t n)
{
    return of_bits((uint64_t)(n + 1023) << 52);
}

/* The integer n of a sum n + ROUNDING. */
ISA_INLINE int64_t shifted_integer(double shifted)
{
    return (int64_t)(bits_of(shifted) - bits_of(ROUNDING));
}

/* a + b, exactly. */
ISA_INLINE double_double exact_sum(double a, double b)
{
    const double sum = a + b, of_b = sum - a;
    return (double_double){sum, (a - (sum - of_b)) + (b - of_b)};
}

/* a b, exactly if no part underflows and |a|, |b| < 2^990. */
ISA_INLINE double_double exact_product(double a, double b)
{
    const double product = a * b, wide_a = a * SPLITTING, wide_b = b * SPLITTING;
    const double high_a = wide_a - (wide_a - a), high_b = wide_b - (wide_b - b), low_a = a - high_a,
                 low_b = b - high_b;
    return (double_double){product,
                           ((high_a * high_b - product) + high_a * low_b + low_a * high_b) + low_a * low_b};
}

ISA_INLINE double_double product(double_double a, double_double b)
{
    const double_double high = exact_product(a.high, b.high);
    return (double_double){high.high, high.low + (a.high * b.low + a.low * b.high)};
}

/* Even and odd powers apart, which halves the chain of dependent operations. */
ISA_INLINE double polynomial(size_t count, const double *coefficient, double x)
{
    const double square = x * x;
    double sum[2] = {0};
    sum[(count - 1) % 2] = coefficient[count - 1];
    sum[count % 2] = coefficient[count - 2];
    for (size_t k = count - 2; k-- > 0;) sum[k % 2] = sum[k % 2] * square + coefficient[k];
    return sum[0] + x * sum[1];
}

/* ---- angles */

typedef struct reduced_angle {
    double_double rest; /* at most pi / 4 */
    unsigned quarter;   /* quarters of a turn that were taken off, modulo 4 */
} reduced_angle;

ISA_INLINE reduced_angle reduce_angle(double angle)
{
    if (fabs(angle) > ELEMENTARY_ANGLE_MOST) angle = fmod(angle, 2 * M_PI);
    const double shifted = angle * M_2_PI + ROUNDING,
                 n = shifted - ROUNDING; /* at most 20 bits: products are exact */
    const double_double first = exact_sum(angle - n * HALF_PI[0], -n * HALF_PI[1]),
                        next = exact_sum(first.high, -n * HALF_PI[2]);
    return (reduced_angle){{next.high, first.low + next.low - n * HALF_PI[3]}, bits_of(shifted) & 3};
}

ISA_INLINE double sine(double_double x)
{
    const double u = x.high * x.high;
    return x.high + (x.high * u * POLYNOMIAL(SINE, u) + x.low * (1 - 0.5 * u));
}

ISA_INLINE double cosine(double_double x)
{
    const double u = x.high * x.high, first = 1 - 0.5 * u;
    return first + (((1 - first) - 0.5 * u) + (u * u * POLYNOMIAL(COSINE, u) - x.high * x.low));
}

double elementary_sin(double angle)
{
    const reduced_angle a = reduce_angle(angle);
    const double value = a.quarter & 1 ? cosine(a.rest) : sine(a.rest);
    return angle == 0 ? angle : a.quarter & 2 ? -value : value;
}

double elementary_cos(double angle)
{
    const reduced_angle a = reduce_angle(angle);
    const double value = a.quarter & 1 ? sine(a.rest) : cosine(a.rest);
    return (a.quarter + 1) & 2 ? -value : value;
}

elementary_sines elementary_sincos(double angle)
{
    const reduced_angle a = reduce_angle(angle);
    const double s = sine(a.rest), c = cosine(a.rest), along = a.quarter & 1 ? c : s,
                 across = a.quarter & 1 ? s : c;
    return (elementary_sines){angle == 0      ? angle
                              : a.quarter & 2 ? -along
                                              : along,
                              (a.quarter + 1) & 2 ? -across : across};
}

double elementary_tan(double angle)
{
    const reduced_angle a = reduce_angle(angle);
    const double s = sine(a.rest), c = cosine(a.rest);
    return angle == 0 ? angle : a.quarter & 1 ? -c / s : s / c;
}

/* Of the smaller magnitude over the larger one, t: above 1/2 as pi / 4 + atan((t - 1) / (t + 1)). The result is then reflected
 * into the octant of (x, y). */
double elementary_atan2(double y, double x)
{
    if (isnan(x) || isnan(y)) return NAN;
    const bool infinite = isinf(x) || isinf(y);
    const double a = infinite ? (double)!!isinf(x) : fabs(x), b = infinite ? (double)!!isinf(y) : fabs(y);
    double large = a > b ? a : b, small = a > b ? b : a;
    const double scale = large > 0x1p1000   ? 0x1p-100
                         : large < 0x1p-900 ? 0x1p100
                                            : 1; /* sums neither overflow nor lose bits */
    large = large > 0 ? large * scale : 1;
    small *= scale;
    const bool folded = small > 0.5 * large;
    const double u = (folded ? small - large : small) / (folded ? small + large : large), z = u * u;
    double angle = u + u * z * POLYNOMIAL(ARCTANGENT, z),
           halves = folded ? 0.5 : 0; /* the result is halves * pi / 2 + angle */
    if (b > a) angle = -angle, halves = 1 - halves;
    if (signbit(x)) angle = -angle, halves = 2 - halves;
    return copysign(halves * HALF_PI[0] + (angle + halves * HALF_PI[1]), y);
}

double elementary_atan(double x)
{
    return elementary_atan2(x, 1);
}

double elementary_acos(double x)
{
    return elementary_atan2(sqrt((1 - x) * (1 + x)), x);
}

/* ---- exponentials and logarithms */

typedef struct reduced_exponent {
    double_double rest; /* at most log(2) / 2, but for rounding */
    int64_t n;          /* multiples of log(2) that were taken off */
} reduced_exponent;

/* Below -746, e^x rounds to 0; above 710 it overflows. The result is the nearest number between; NaN stays NaN. */
ISA_INLINE double exponent_in_range(double x)
{
    return x < -746 ? -746 : x > 710 ? 710 : x;
}

ISA_INLINE reduced_exponent reduce_exponent(double_double x)
{
    const double high = exponent_in_range(x.high), shifted = high * OVER_LOG_2[0] + ROUNDING,
                 n = shifted - ROUNDING;
    const double_double rest = exact_sum(high - n * LOG_2[0], -n * LOG_2[1]);
    const double low = high == x.high ? rest.low + x.low : 0;
    return (reduced_exponent){exact_sum(rest.high, low), shifted_integer(shifted)};
}

/* value 2^n for a value from 1/2 to 2; the result may be subnormal or infinite. */
ISA_INLINE double scale_by_power(double value, int64_t n)
{
    if (n >= -1021 && n <= 1022) return of_bits(bits_of(value) + ((uint64_t)n << 52));
    return value * power_of_two(n >> 1) * power_of_two(n - (n >> 1));
}

/* e^x - 1 - x for a reduced x */
ISA_INLINE double second_order(double x)
{
    return x * x * POLYNOMIAL(EXPONENTIAL, x);
}

/* e^x. The error before the last rounding is at most 1/8 of a unit in the last place. */
ISA_INLINE double exponential(double_double x)
{
    const reduced_exponent e = reduce_exponent(x);
    const double_double first = exact_sum(1, e.rest.high);
    return scale_by_power(first.high + (first.low + (second_order(e.rest.high) + e.rest.low)), e.n);
}

/* A positive, finite number 2^exponent mantissa, with a mantissa from sqrt(1/2) to sqrt(2). */
typedef struct binary_parts {
    double exponent, mantissa;
} binary_parts;

ISA_INLINE binary_parts binary_parts_of(double x)
{
    const bool subnormal = x < 0x1p-1022;
    const uint64_t bits = bits_of(subnormal ? x * 0x1p54 : x);
    const int64_t exponent = (int64_t)(bits - bits_of(SQRT_HALF)) >> 52;
    return (binary_parts){(double)(subnormal ? exponent - 54 : exponent),
                          of_bits(bits - ((uint64_t)exponent << 52))};
}

/* The logarithm of a positive, finite number with an error of 2^-63 of it: with s = (m - 1) / (m + 1), log(m) = 2 atanh(s). */
ISA_INLINE double_double logarithm(double x)
{
    const binary_parts part = binary_parts_of(x);
    const double f = part.mantissa - 1;
    const double_double below = exact_sum(part.mantissa, 1);
    double_double s = {f / below.high, 0};
    const double_double back = exact_product(s.high, below.high);
    s.low = ((f - back.high) - back.low - s.high * below.low) / below.high;
    const double_double z = product(s, s);
    const double_double series = exact_sum(THIRD[0], z.high * POLYNOMIAL(LOGARITHM, z.high));
    const double_double third_order =
        product(s, product(z, (double_double){series.high, series.low + THIRD[1]}));
    const double_double atanh = exact_sum(s.high, third_order.high);
    const double_double sum = exact_sum(part.exponent * LOG_2[0], 2 * atanh.high);
    return (double_double){sum.high,
                           sum.low + (2 * (atanh.low + s.low + third_order.low) + part.exponent * LOG_2[1])};
}

static bool has_logarithm(double x)
{
    return x > 0 && x < INFINITY;
}

/* Of what has no logarithm. */
static double limit_of_logarithm(double x)
{
    return x == 0 ? -INFINITY : x > 0 ? x : NAN;
}

static double logarithm_over(double x, const double base[2])
{
    if (!has_logarithm(x)) return limit_of_logarithm(x);
    const double_double l = product(logarithm(x), (double_double){base[0], base[1]});
    return l.high + l.low;
}

double elementary_exp(double x)
{
    const double near = exponent_in_range(x), shifted = near * OVER_LOG_2[0] + ROUNDING,
                 n = shifted - ROUNDING;
    const double rest = near - n * LOG_2[0] - n * LOG_2[1];
    return scale_by_power(1 + (rest + second_order(rest)), shifted_integer(shifted));
}

double elementary_exp2(double x)
{
    const double near = x < -1100  ? -1100
                        : x > 1100 ? 1100
                                   : x,
                 shifted = near + ROUNDING, rest = (near - (shifted - ROUNDING)) * M_LN2;
    return scale_by_power(1 + (rest + second_order(rest)), shifted_integer(shifted));
}

/* With s = f / (2 + f), 2 s = f - s f: the rounding of s then affects a small part only. */
double elementary_log(double x)
{
    if (!has_logarithm(x)) return limit_of_logarithm(x);
    const binary_parts part = binary_parts_of(x);
    const double f = part.mantissa - 1, s = f / (2 + f), z = s * s;
    const double third_order = 2 * z * (THIRD[0] + z * POLYNOMIAL(LOGARITHM, z));
    return part.exponent * LOG_2[0] + (f - (s * (f - third_order) - part.exponent * LOG_2[1]));
}

double elementary_log2(double x)
{
    return logarithm_over(x, OVER_LOG_2);
}

double elementary_log10(double x)
{
    return logarithm_over(x, OVER_LOG_10);
}

/* log(y + e) = log(y) + e / y, where y is 1 + x rounded and e its error */
double elementary_log1p(double x)
{
    const double_double y = exact_sum(1, x);
    if (!has_logarithm(y.high)) return limit_of_logarithm(y.high);
    return x == 0 ? x : elementary_log(y.high) + y.low / y.high;
}

double elementary_pow(double x, double y)
{
    if (y == 0 || x == 1) return 1;
    if (isnan(x) || isnan(y)) return NAN;
    const bool integer = trunc(y) == y;
    if (x < 0 && isfinite(x) && !integer) return NAN;
    const double sign = signbit(x) && integer && isfinite(y) && fmod(y, 2) != 0 ? -1 : 1, of = fabs(x);
    if (!has_logarithm(of)) return sign * ((of == 0) == (y > 0) ? 0 : INFINITY);
    const double near = fabs(y) > 0x1p65 ? copysign(0x1p65, y) : y; /* |log(of)| is 0 or at least 2^-53 */
    return sign * exponential(product(logarithm(of), (double_double){near, 0}));
}

double elementary_cbrt(double x)
{
    if (!has_logarithm(fabs(x))) return x;
    return copysign(exponential(product(logarithm(fabs(x)), (double_double){THIRD[0], THIRD[1]})), x);
}

double elementary_hypot(double x, double y)
{
    if (isinf(x) || isinf(y)) return INFINITY;
    const double large = fabs(x) > fabs(y) ? fabs(x) : fabs(y);
    const double scale = large > 0x1p500    ? 0x1p-600
                         : large < 0x1p-500 ? 0x1p600
                                            : 1; /* squares stay in the range */
    return sqrt(x * scale * (x * scale) + y * scale * (y * scale)) / scale;
}

/* t / (t + 2) with t = e^(2 |x|) - 1 */
double elementary_tanh(double x)
{
    const double twice = 2 * fabs(x);
    const reduced_exponent e = reduce_exponent((double_double){twice > 64 ? 64 : twice, 0});
    const double factor = power_of_two(e.n),
                 t = (factor - 1) + factor * (e.rest.high + (second_order(e.rest.high) + e.rest.low));
    return copysign(t / (t + 2), x);
}
