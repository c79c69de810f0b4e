// SPDX-License-Identifier: Apache-2.0
/* compare: comparison functions for qsort, minimum and maximum. Pure functions, any thread. */
#ifndef HEXAD_BASE_CORE_COMPARE_H
#define HEXAD_BASE_CORE_COMPARE_H

#include <stdint.h>

/* Ascending doubles; NaN is not permitted. */
static inline int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static inline int compare_ints(const void *a, const void *b)
{
    int x = *(const int *)a, y = *(const int *)b;
    return (x > y) - (x < y);
}

static inline int compare_uint32(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

/* As fmin and fmax, which are calls, in one instruction. If b is NaN, returns a. */
static inline double compare_smaller(double a, double b)
{
    return b < a ? b : a;
}

static inline double compare_larger(double a, double b)
{
    return b > a ? b : a;
}

#endif
