// SPDX-License-Identifier: Apache-2.0
/* triangle_moments: exact integrals over a triangle in the plane, of monomials and of powers of a distance.
 *
 * The integral of a function that is homogeneous of degree d about a centre is the sum over the sides of the
 * integral along the side, times its distance from the centre, over d + 2. Corners are in counterclockwise order.
 * Pure functions, any thread.
 */
#ifndef HEXAD_SAMPLING_WEIGHTS_TRIANGLE_MOMENTS_H
#define HEXAD_SAMPLING_WEIGHTS_TRIANGLE_MOMENTS_H

enum { TRIANGLE_MOMENTS_DEGREE = 7 };

/* The integrals of x^(d - j) y^j for the degrees d = 0 .. degree, at most TRIANGLE_MOMENTS_DEGREE, and
 * j = 0 .. d: (degree + 1) (degree + 2) / 2 values in this order. */
void triangle_moments_monomials(const double corner[3][2], int degree, double *out);

/* The integral of the 7th power of the distance from the centre. */
double triangle_moments_distance7(const double corner[3][2], double x, double y);

#endif
