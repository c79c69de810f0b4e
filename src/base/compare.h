/* compare: orders for qsort, and the smaller and the larger of two. Pure functions, any thread. */
#ifndef HEXAD_BASE_COMPARE_H
#define HEXAD_BASE_COMPARE_H

/* Of two doubles, the smaller first; NaN has no place. */
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

/* As fmin and fmax, which are calls, in one instruction. A `b` that is NaN is left out. */
static inline double compare_smaller(double a, double b)
{
    return b < a ? b : a;
}

static inline double compare_larger(double a, double b)
{
    return b > a ? b : a;
}

#endif
