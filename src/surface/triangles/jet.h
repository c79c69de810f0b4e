// SPDX-License-Identifier: Apache-2.0
/* jet: polynomials w(u, v) of degree 2 to 4 through heights over a tangent plane, by least squares, and the
 * curvatures of their graphs (Cazals and Pouget 2005, "Estimating differential quantities using polynomial
 * fitting of osculating jets").
 *
 * Systems are solved by their normal equations, JET_LANES at a time, one in each lane. A condition (jet_condition) of c
 * costs a factor of about 1 / c^2 in precision: for c = .02, four of sixteen digits. Monomials are in the order of their
 * degrees, so that one factorisation contains the fits of all lower degrees. Sums have a fixed
 * order: results of a lane do not depend on other lanes or on the instruction set. Pure functions, any thread.
 */
#ifndef HEXAD_SURFACE_TRIANGLES_JET_H
#define HEXAD_SURFACE_TRIANGLES_JET_H

#include <stdbool.h>

enum { JET_LANES = 4, JET_ROWS = 64, JET_DEGREE = 4, JET_COLUMNS = (JET_DEGREE + 1) * (JET_DEGREE + 2) / 2 };

/* The number of coefficients of a polynomial. */
static inline int jet_coefficients(int degree)
{
    return (degree + 1) * (degree + 2) / 2;
}

/* One number for each lane. */
typedef double jet_numbers __attribute__((vector_size(JET_LANES * sizeof(double))));

/* Allocate it with mem_array, which aligns it for vector units. */
typedef struct jet_lanes {
    /* Input: places (u, v), weights, and heights over the places times their weights. A lane with fewer rows than
     * others has zeros. Lengths are scaled by the caller, so that |u| and |v| are about 1. */
    int rows;
    jet_numbers u[JET_ROWS], v[JET_ROWS], weight[JET_ROWS], w[JET_ROWS];
    /* Output of jet_factor: the factor R of each system, of columns with the norm 1 (upper triangle of `factor`; its
     * diagonal, and 1 over it, or 0), the norms, and the transformed heights. */
    jet_numbers factor[JET_COLUMNS][JET_COLUMNS], diagonal[JET_COLUMNS], inverse[JET_COLUMNS],
        norm[JET_COLUMNS], height[JET_COLUMNS];
} jet_lanes;

/* The graph's value and derivatives at u = v = 0. */
typedef struct jet {
    double w, wu, wv, wuu, wuv, wvv;
} jet;

void jet_factor(jet_lanes *j);

/* The condition of the fit of a degree: the smallest distance of a column, of norm 1, from the span of the
 * columns before it. 0: the heights do not determine the polynomial. */
double jet_condition(const jet_lanes *j, int lane, int degree);

/* The polynomials of a degree, one for each lane. That of a lane with a condition of 0 is meaningless. */
void jet_solve(const jet_lanes *j, int degree, jet out[JET_LANES]);

/* A fit on a strip: the places (u, v) lie on two parallel lines, or so near to them that the second derivative across
 * the lines is unknown; that derivative is 0. Monomials that depend on those before them are left out. `least`: see
 * jet_condition. False, with *out unchanged: the places do not determine all other derivatives up to the second, or
 * determine that one, too. */
bool jet_solve_strip(const jet_lanes *j, int lane, int degree, double least, jet *out);

#endif
