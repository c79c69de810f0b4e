#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prints the constants of src/base/core/elementary.c, and the error of each polynomial.

    tools/polynomials.py

Each polynomial interpolates a power series at the Chebyshev points of its interval and is rounded to doubles. The error is that of the
rounded polynomial against the series, at 1 000 points, relative to the elementary function whose part the series is. A number that is
needed to more than 53 bits is the sum of doubles.
"""
import math
from decimal import Decimal, getcontext
from fractions import Fraction

getcontext().prec = 60
TERMS = 90  # of a power series; the slowest, of the arctangent at 1/4, has a ratio of 1/4: 2^-180
PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459")
LOG_2, LOG_10 = Decimal(2).ln(), Decimal(10).ln()
SQRT_HALF = Decimal("0.5").sqrt()
ZERO = Decimal(0)

# Name, number, bits of each double but the last, which is rounded to 53. With 33 bits, a product with an integer of 20 bits is exact;
# with 42 bits, one with an integer of 11 bits.
CONSTANTS = (("HALF_PI", PI / 2, (33, 33, 33)), ("LOG_2", LOG_2, (42,)), ("OVER_LOG_2", 1 / LOG_2, (53,)), ("OVER_LOG_10", 1 / LOG_10, (53,)),
             ("THIRD", 1 / Decimal(3), (53,)))


def factorial(n):
    return Decimal(math.factorial(n))


def polynomials():
    """Name, series, its coefficient k, interval, number of coefficients, and the factor that makes of an absolute error one relative to the
    elementary function: its largest value on the interval."""
    square, half = (PI / 4) ** 2, LOG_2 / 2
    odd = ((1 - SQRT_HALF) / (1 + SQRT_HALF)) ** 2  # s^2 of log: s = (m - 1) / (m + 1), m from sqrt(1/2) to sqrt(2)
    yield "SINE", "(sin(sqrt(u)) / sqrt(u) - 1) / u", lambda k: (-1) ** (k + 1) / factorial(2 * k + 3), (ZERO, square), 6, square
    yield ("COSINE", "(cos(sqrt(u)) - 1 + u / 2) / u^2", lambda k: (-1) ** k / factorial(2 * k + 4), (ZERO, square), 6,
           square ** 2 / SQRT_HALF)
    yield "EXPONENTIAL", "(exp(r) - 1 - r) / r^2", lambda k: 1 / factorial(k + 2), (-half, half), 11, half ** 2 / SQRT_HALF
    yield ("LOGARITHM", "(atanh(sqrt(z)) / sqrt(z) - 1 - z / 3) / z^2", lambda k: 1 / Decimal(2 * k + 5), (ZERO, odd), 8, odd ** 2)
    yield ("ARCTANGENT", "(atan(sqrt(z)) / sqrt(z) - 1) / z", lambda k: (-1) ** (k + 1) / Decimal(2 * k + 3), (ZERO, Decimal("0.25")), 13,
           Decimal("0.25"))


def value(coefficients, x):
    result = ZERO
    for c in reversed(coefficients):
        result = result * x + c
    return result


def chebyshev_points(interval, count):
    cosine = [(-1) ** k / factorial(2 * k) for k in range(30)]
    middle, half = (interval[0] + interval[1]) / 2, (interval[1] - interval[0]) / 2
    return [middle + half * value(cosine, (PI * (2 * k + 1) / (2 * count)) ** 2) for k in range(count)]


def interpolated(points, values):
    """Coefficients, lowest first, of the polynomial through the points: Newton's divided differences, expanded."""
    differences = list(values)
    for step in range(1, len(points)):
        for k in range(len(points) - 1, step - 1, -1):
            differences[k] = (differences[k] - differences[k - 1]) / (points[k] - points[k - step])
    result = [ZERO]
    for x, difference in zip(reversed(points), reversed(differences)):
        result = [below - x * here for below, here in zip([ZERO, *result], [*result, ZERO])]
        result[0] += difference
    return result[:len(points)]


def parts(number, bits):
    """Doubles whose sum is the number: all but the last are cut to these bits."""
    found, left = [], Fraction(number)
    for count in bits:
        unit = Fraction(2) ** (math.frexp(float(left))[1] - count)
        found.append(float(left // unit * unit))
        left -= Fraction(found[-1])
    return [*found, float(left)]


def main():
    for name, number, bits in CONSTANTS:
        print(f"static const double {name}[] = {{{', '.join(part.hex() for part in parts(number, bits))}}};")
    for name, what, coefficient, interval, count, factor in polynomials():
        series = [coefficient(k) for k in range(TERMS)]
        points = chebyshev_points(interval, count)
        rounded = [float(c) for c in interpolated(points, [value(series, x) for x in points])]
        exact = [Decimal(c) for c in rounded]
        places = [interval[0] + (interval[1] - interval[0]) * k / 1000 for k in range(1001)]
        error = max(abs(value(exact, x) - value(series, x)) for x in places) * factor
        print(f"/* {what}, {interval[0]:.4g} to {interval[1]:.4g}: error {error:.1e} */")
        print(f"static const double {name}[] = {{{', '.join(c.hex() for c in rounded)}}};")


if __name__ == "__main__":
    main()
