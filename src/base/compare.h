/* compare: orders for qsort. Pure functions, any thread. */
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

#endif
