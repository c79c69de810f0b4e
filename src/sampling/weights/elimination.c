// SPDX-License-Identifier: Apache-2.0
#include "sampling/weights/elimination.h"

#include <math.h>

#include "base/core/isa.h"

/* Unknowns that are eliminated together. With 4, each number of the remaining matrix is read and written a quarter
 * as often as with 1. */
enum { PANEL = 4 };

static void swap_rows(double *a, double *b, int begin, int end)
{
    for (int j = begin; j < end; j++) {
        const double kept = a[j];
        a[j] = b[j];
        b[j] = kept;
    }
}

/* Exchanges rows, and computes the factors of the unknowns k .. last - 1 below the diagonal. The columns before `end`
 * are eliminated. */
static bool factor_panel(double *a, int n, int columns, int stride, int k, int last, int end)
{
    for (int c = k; c < last; c++) {
        double *top = a + c * stride;
        int best = c;
        for (int i = c + 1; i < n; i++)
            if (fabs(a[i * stride + c]) > fabs(a[best * stride + c])) best = i;
        if (best != c) swap_rows(top, a + best * stride, k, columns);
        const double inverse = 1 / top[c];
        if (!isfinite(inverse)) return false;
        for (int i = c + 1; i < n; i++) {
            double *row = a + i * stride;
            row[c] *= inverse;
            for (int j = c + 1; j < end; j++) row[j] -= row[c] * top[j];
        }
    }
    return true;
}

/* Subtracts multiples of the PANEL rows `top` from a row. */
ISA_INLINE void subtract_rows(const double *restrict top, int stride, const double *restrict factor,
                              int count, double *restrict row)
{
    for (int j = 0; j < count; j++)
        row[j] = row[j] - factor[0] * top[j] - factor[1] * top[stride + j] - factor[2] * top[2 * stride + j] -
                 factor[3] * top[3 * stride + j];
}

/* Eliminates the unknowns k .. k + PANEL - 1, whose factors are known, from the later columns. */
ISA_CLONES static void eliminate(double *a, int n, int columns, int stride, int k)
{
    double *top = a + k * stride + k;
    const int rest = columns - k - PANEL;
    for (int i = 1; i < PANEL; i++)
        for (int j = 0; j < i; j++)
            for (int c = PANEL; c < PANEL + rest; c++)
                top[i * stride + c] -= top[i * stride + j] * top[j * stride + c];
    for (int i = PANEL; i < n - k; i++)
        subtract_rows(top + PANEL, stride, top + i * stride, rest, top + i * stride + PANEL);
}

bool elimination_reduce(double *a, int n, int columns, int stride)
{
    int k = 0;
    for (; k + PANEL <= n; k += PANEL) {
        if (!factor_panel(a, n, columns, stride, k, k + PANEL, k + PANEL)) return false;
        eliminate(a, n, columns, stride, k);
    }
    return factor_panel(a, n, columns, stride, k, n, columns); /* fewer than PANEL unknowns remain */
}

void elimination_solve(const double *a, int n, int stride, int side, int first, double *x)
{
    for (int i = n - 1; i >= first; i--) {
        double sum = a[i * stride + side];
        for (int j = i + 1; j < n; j++) sum -= a[i * stride + j] * x[j];
        x[i] = sum / a[i * stride + i];
    }
}
