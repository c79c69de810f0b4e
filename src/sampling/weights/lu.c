// SPDX-License-Identifier: Apache-2.0
#include "sampling/weights/lu.h"

#include <math.h>

#include "base/core/isa.h"

/* Columns that are eliminated together. With 4, each number of the remaining matrix is read and written a quarter
 * as often as with 1. */
enum { PANEL = 4 };

static void swap_rows(double *a, double *b, int n)
{
    for (int j = 0; j < n; j++) {
        const double kept = a[j];
        a[j] = b[j];
        b[j] = kept;
    }
}

/* Factors the columns k .. end - 1. */
static bool factor_panel(double *a, int n, int stride, int k, int end, int *pivot)
{
    for (int c = k; c < end; c++) {
        double *top = a + (long)c * stride;
        int best = c;
        for (int i = c + 1; i < n; i++)
            if (fabs(a[(long)i * stride + c]) > fabs(a[(long)best * stride + c])) best = i;
        pivot[c] = best;
        if (best != c) swap_rows(top, a + (long)best * stride, n);
        const double inverse = 1 / top[c];
        if (!isfinite(inverse)) return false;
        for (int i = c + 1; i < n; i++) {
            double *row = a + (long)i * stride;
            row[c] *= inverse;
            for (int j = c + 1; j < end; j++) row[j] -= row[c] * top[j];
        }
    }
    return true;
}

/* Subtracts multiples of the PANEL rows `top` from a row. */
ISA_INLINE void subtract_rows(const double *restrict top, int stride, const double *factor, int columns,
                              double *restrict row)
{
    for (int j = 0; j < columns; j++)
        row[j] = row[j] - factor[0] * top[j] - factor[1] * top[stride + j] - factor[2] * top[2 * stride + j] -
                 factor[3] * top[3 * stride + j];
}

/* Eliminates the columns k .. k + PANEL - 1, which are factored, from the other columns. */
ISA_CLONES static void eliminate(double *a, int n, int stride, int k)
{
    const int rest = n - k - PANEL;
    double *top = a + (long)k * stride + k;
    for (int i = 1; i < PANEL; i++)
        for (int j = 0; j < i; j++)
            for (int c = PANEL; c < PANEL + rest; c++)
                top[i * stride + c] -= top[i * stride + j] * top[j * stride + c];
    for (int i = PANEL; i < PANEL + rest; i++)
        subtract_rows(top + PANEL, stride, top + (long)i * stride, rest, top + (long)i * stride + PANEL);
}

bool lu_factor(double *a, int n, int stride, int *pivot)
{
    for (int k = 0; k < n; k += PANEL) {
        const int end = k + PANEL < n ? k + PANEL : n;
        if (!factor_panel(a, n, stride, k, end, pivot)) return false;
        if (end < n) eliminate(a, n, stride, k);
    }
    return true;
}

ISA_CLONES void lu_solve(const double *a, int n, int stride, const int *pivot, double *b, int columns)
{
    for (int i = 0; i < n; i++)
        if (pivot[i] != i) swap_rows(b + (long)i * columns, b + (long)pivot[i] * columns, columns);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++)
            for (int c = 0; c < columns; c++)
                b[i * columns + c] -= a[(long)i * stride + j] * b[j * columns + c];
    for (int i = n - 1; i >= 0; i--) {
        for (int j = i + 1; j < n; j++)
            for (int c = 0; c < columns; c++)
                b[i * columns + c] -= a[(long)i * stride + j] * b[j * columns + c];
        for (int c = 0; c < columns; c++) b[i * columns + c] /= a[(long)i * stride + i];
    }
}
