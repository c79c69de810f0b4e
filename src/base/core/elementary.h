// SPDX-License-Identifier: Apache-2.0
/* elementary: the elementary functions, with the same bits on every processor and for every instruction set. The C library's
 * depend on the processor. Pure functions, any thread; rounding to nearest is assumed.
 *
 * Largest errors that the test measures, in units in the last place; the bound is 3:
 *
 *   log2, log10           0.5
 *   pow, cbrt             0.7
 *   sin, cos              0.9
 *   exp, exp2, log        1.0
 *   hypot                 1.2
 *   log1p                 1.5
 *   atan, atan2           1.9
 *   tan, tanh, acos       2.5
 *
 * Results that are doubles are exact: powers of integers, logarithms of powers of 2 and 10, cube roots of cubes.
 * Zeros, infinities and NaN are treated as C11, annex F, describes.
 *
 * Method: an argument is reduced to a short interval (W. J. Cody and W. Waite, Software Manual for the Elementary Functions,
 * 1980), where a polynomial of tools/polynomials.py is evaluated. Logarithms and powers use sums of two doubles (T. J. Dekker,
 * A floating-point technique for extending the available precision, Numerische Mathematik 18, 1971). */
#ifndef HEXAD_BASE_CORE_ELEMENTARY_H
#define HEXAD_BASE_CORE_ELEMENTARY_H

/* The largest angle with the errors above. A larger one is first reduced exactly by the double next to 2 pi, which has the
 * effect of an error of 2^-54 of the angle. */
#define ELEMENTARY_ANGLE_MOST 0x1.9p20

typedef struct elementary_sines {
    double sin, cos;
} elementary_sines;

/* The compiler may merge equal calls. */
#define ELEMENTARY __attribute__((const))

ELEMENTARY double elementary_sin(double angle);
ELEMENTARY double elementary_cos(double angle);
ELEMENTARY elementary_sines elementary_sincos(double angle);
ELEMENTARY double elementary_tan(double angle);
ELEMENTARY double elementary_acos(double x);
ELEMENTARY double elementary_atan(double x);
ELEMENTARY double elementary_atan2(double y, double x);

ELEMENTARY double elementary_exp(double x);
ELEMENTARY double elementary_exp2(double x);
ELEMENTARY double elementary_log(double x);
ELEMENTARY double elementary_log2(double x);
ELEMENTARY double elementary_log10(double x);
ELEMENTARY double elementary_log1p(double x);
ELEMENTARY double elementary_pow(double x, double y);
ELEMENTARY double elementary_cbrt(double x);
ELEMENTARY double elementary_hypot(double x, double y);
ELEMENTARY double elementary_tanh(double x);

#endif
