// SPDX-License-Identifier: Apache-2.0
/* elimination: solution of small dense systems of linear equations, by Gaussian elimination with partial pivoting.
 *
 * A system is a matrix of n rows, `stride` numbers apart: n coefficients and then a number for each right side. Each
 * number is computed by the same operations in the same order on every processor: results have the same bytes
 * everywhere. Pure functions, any thread.
 */
#ifndef HEXAD_SAMPLING_WEIGHTS_ELIMINATION_H
#define HEXAD_SAMPLING_WEIGHTS_ELIMINATION_H

#include <stdbool.h>

/* Makes the coefficients an upper triangle, of a system with `columns` numbers in each row. Numbers below the diagonal
 * are undefined afterwards. False: the system is singular, or a number is not finite. */
bool elimination_reduce(double *a, int n, int columns, int stride);

/* Computes the unknowns first .. n - 1 of a reduced system, for the right side in column `side`. */
void elimination_solve(const double *a, int n, int stride, int side, int first, double *x);

#endif
