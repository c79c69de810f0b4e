// SPDX-License-Identifier: Apache-2.0
/* cholesky: solves small systems of equations with a positive definite matrix. Pure functions, any thread. */
#ifndef HEXAD_GEOMETRY_SPACE_CHOLESKY_H
#define HEXAD_GEOMETRY_SPACE_CHOLESKY_H

#include <math.h>

/* Solves a x = b in place, for n unknowns. Row i of `a` begins at a + i stride; only its lower half is used. */
static inline void cholesky_solve(double *a, int stride, int n, double *b)
{
    for (int i = 0; i < n; i++) {
        double *row = a + i * stride;
        for (int j = 0; j <= i; j++) {
            const double *other = a + j * stride;
            double sum = row[j];
            for (int k = 0; k < j; k++) sum -= row[k] * other[k];
            row[j] = i == j ? sqrt(sum) : sum / other[j];
        }
        for (int k = 0; k < i; k++) b[i] -= row[k] * b[k];
        b[i] /= row[i];
    }
    for (int i = n; i-- > 0;) {
        for (int k = i + 1; k < n; k++) b[i] -= a[k * stride + i] * b[k];
        b[i] /= a[i * stride + i];
    }
}

#endif
