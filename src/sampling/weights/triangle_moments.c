// SPDX-License-Identifier: Apache-2.0
#include "sampling/weights/triangle_moments.h"

#include <math.h>

#include "base/core/elementary.h"

/* Quadrature of Gauss and Legendre on 0 .. 1, exact to degree 7. */
enum { GAUSS = 4 };
static const double gauss_place[GAUSS] = {0.069431844202973712, 0.33000947820757187, 0.66999052179242813,
                                          0.93056815579702629},
                    gauss_weight[GAUSS] = {0.17392742256872693, 0.32607257743127307, 0.32607257743127307,
                                           0.17392742256872693};

void triangle_moments_monomials(const double corner[3][2], int degree, double *out)
{
    for (int k = 0; k < (degree + 1) * (degree + 2) / 2; k++) out[k] = 0;
    for (int side = 0; side < 3; side++) {
        const double *p = corner[side], *q = corner[(side + 1) % 3], cross = p[0] * q[1] - p[1] * q[0];
        for (int g = 0; g < GAUSS; g++) {
            const double x = p[0] + gauss_place[g] * (q[0] - p[0]), y = p[1] + gauss_place[g] * (q[1] - p[1]);
            double power[TRIANGLE_MOMENTS_DEGREE + 2] = {gauss_weight[g] * cross}; /* x^(d - j) y^j */
            for (int d = 0, k = 0; d <= degree; d++) {
                for (int j = 0; j <= d; j++) out[k++] += power[j] / (d + 2);
                power[d + 1] = power[d] * y;
                for (int j = 0; j <= d; j++) power[j] *= x;
            }
        }
    }
}

/* The part of the antiderivative of (a^2 + b^2)^(7/2) over b that is algebraic, times 384; r^2 = a^2 + b^2. */
static double algebraic(double a2, double b, double r)
{
    const double b2 = b * b;
    return b * r * (a2 * a2 * (279 * a2 + 326 * b2) + b2 * b2 * (200 * a2 + 48 * b2));
}

/* arsinh(d / a) - arsinh(b / a), with s^2 = a^2 + d^2 and r^2 = a^2 + b^2. */
static double arsinh_difference(double a2, double b, double r, double d, double s)
{
    const double far = fabs(d) + s, near = fabs(b) + r;
    if (b < 0 && d > 0) return elementary_log(far * near / a2);
    return b < 0 ? elementary_log(near / far) : elementary_log(far / near);
}

double triangle_moments_distance7(const double corner[3][2], double x, double y)
{
    double sum = 0;
    for (int side = 0; side < 3; side++) {
        const double *p = corner[side], *q = corner[(side + 1) % 3], px = p[0] - x, py = p[1] - y,
                     qx = q[0] - x, qy = q[1] - y,
                     length = sqrt((qx - px) * (qx - px) + (qy - py) * (qy - py)),
                     a = (px * qy - py * qx) / length, a2 = a * a, a8 = a2 * a2 * a2 * a2,
                     ux = (qx - px) / length, uy = (qy - py) / length, b = ux * px + uy * py,
                     d = ux * qx + uy * qy, r = sqrt(a2 + b * b), s = sqrt(a2 + d * d);
        double along = algebraic(a2, d, s) - algebraic(a2, b, r);
        if (a8 > 0) along += 105 * a8 * arsinh_difference(a2, b, r, d, s);
        sum += a * along;
    }
    return sum / (9 * 384);
}
