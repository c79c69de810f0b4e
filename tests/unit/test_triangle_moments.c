// SPDX-License-Identifier: Apache-2.0
/* Integrals over triangles: known ones, and quadrature in polar coordinates about the centre. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "close.h"
#include "shapes.h"
#include "sampling/weights/triangle_moments.h"

enum { DEGREE = TRIANGLE_MOMENTS_DEGREE, TERMS = (DEGREE + 1) * (DEGREE + 2) / 2, TRIANGLES = 200 };

/* Over the triangle (0, 0), (1, 0), (0, 1) the integral of x^i y^j is i! j! / (i + j + 2)!. */
static void monomials_over_the_unit_triangle_are_known(void **state)
{
    (void)state;
    static const double corner[3][2] = {{0, 0}, {1, 0}, {0, 1}};
    double found[TERMS];
    triangle_moments_monomials(corner, DEGREE, found);
    for (int d = 0, k = 0; d <= DEGREE; d++)
        for (int j = 0; j <= d; j++, k++)
            assert_close(found[k], tgamma(d - j + 1) * tgamma(j + 1) / tgamma(d + 3), 1e-15);
}

/* A lower degree gives the first values of a higher one. A triangle that is cut in two has the sum of both. */
static void monomials_add_up_over_parts(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    for (int t = 0; t < TRIANGLES; t++) {
        double c[3][2], one[3][2], other[3][2], whole[TERMS], a[TERMS], b[TERMS];
        for (int k = 0; k < 6; k++) c[k / 2][k % 2] = 2 * rng_uniform(&r) - 1;
        const double cut = rng_uniform(&r);
        for (int k = 0; k < 6; k++) one[k / 2][k % 2] = other[k / 2][k % 2] = c[k / 2][k % 2];
        for (int axis = 0; axis < 2; axis++)
            one[1][axis] = other[0][axis] = c[0][axis] + cut * (c[1][axis] - c[0][axis]);
        triangle_moments_monomials((const double(*)[2])c, DEGREE, whole);
        triangle_moments_monomials((const double(*)[2])one, DEGREE, a);
        triangle_moments_monomials((const double(*)[2])other, DEGREE - 1, b);
        for (int k = 0; k < TERMS - DEGREE - 1; k++) assert_close(a[k] + b[k], whole[k], 1e-14);
    }
}

/* The integral of r^7 over a triangle with a corner at the origin, in polar coordinates: the integral of R^9 / 9 over
 * the angle, by Simpson's rule along the side, where R is the distance of the side. */
static double fan(double px, double py, double qx, double qy)
{
    enum { PARTS = 2000 };
    const double cross = px * qy - py * qx;
    double sum = 0;
    for (int k = 0; k <= PARTS; k++) {
        const double t = (double)k / PARTS, x = px + t * (qx - px), y = py + t * (qy - py),
                     weight = k == 0 || k == PARTS ? 1
                              : k % 2              ? 4
                                                   : 2;
        sum += weight * pow(x * x + y * y, 3.5);
    }
    return sum / (3 * PARTS) * cross / 9;
}

/* Centres inside, outside, far away, at corners, on sides and on the lines of sides. */
static void powers_of_the_distance_are_integrated(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    for (int t = 0; t < TRIANGLES; t++) {
        double c[3][2], x[2], expected = 0;
        for (int k = 0; k < 6; k++) c[k / 2][k % 2] = 0.4 * rng_uniform(&r) - 0.2;
        const double along = t % 8 == 1 ? 0 : t % 8 == 2 ? 0.5 : 3;
        for (int axis = 0; axis < 2; axis++) {
            x[axis] = 2 * rng_uniform(&r) - 1;
            if (t % 8 == 0) x[axis] = (c[0][axis] + c[1][axis] + c[2][axis]) / 3;
            if (t % 8 >= 1 && t % 8 <= 3) x[axis] = c[0][axis] + along * (c[1][axis] - c[0][axis]);
            if (t % 8 == 4) x[axis] = c[2][axis] + 1e-9;
        }
        for (int k = 0; k < 3; k++)
            expected +=
                fan(c[k][0] - x[0], c[k][1] - x[1], c[(k + 1) % 3][0] - x[0], c[(k + 1) % 3][1] - x[1]);
        const double found = triangle_moments_distance7((const double(*)[2])c, x[0], x[1]);
        assert_close(found, expected, 1e-13);
        assert_close(found, expected, 1e-9 * fabs(expected) + 1e-16);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(monomials_over_the_unit_triangle_are_known),
        cmocka_unit_test(monomials_add_up_over_parts),
        cmocka_unit_test(powers_of_the_distance_are_integrated),
    };
    return cmocka_run_group_tests_name("triangle_moments", tests, NULL, NULL);
}
