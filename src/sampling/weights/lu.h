// SPDX-License-Identifier: Apache-2.0
/* lu: solution of small dense systems of linear equations, by LU factorisation with partial pivoting.
 *
 * Matrices are stored row by row, `stride` numbers apart. Each number is computed by the same operations in the
 * same order on every processor: results have the same bytes everywhere. Pure functions, any thread.
 */
#ifndef HEXAD_SAMPLING_WEIGHTS_LU_H
#define HEXAD_SAMPLING_WEIGHTS_LU_H

#include <stdbool.h>

/* Replaces the matrix of n x n numbers by its factors. `pivot` receives the row that was exchanged with each row.
 * False: the matrix is singular, or a number is not finite. */
bool lu_factor(double *a, int n, int stride, int *pivot);

/* Replaces the right sides `b`, n rows of `columns` numbers without gaps, by the solutions. */
void lu_solve(const double *a, int n, int stride, const int *pivot, double *b, int columns);

#endif
