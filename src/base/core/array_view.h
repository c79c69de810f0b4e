// SPDX-License-Identifier: Apache-2.0
/* array_view: an array of numbers in memory of the caller, with a stride along each axis, as NumPy has it. Pure
 * functions; any thread. */
#ifndef HEXAD_BASE_CORE_ARRAY_VIEW_H
#define HEXAD_BASE_CORE_ARRAY_VIEW_H

#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/number.h"

enum { ARRAY_VIEW_DIMENSIONS = 4 };

typedef struct array_view {
    const void *data; /* element (0, 0, ...), at any address; NULL: there is no array */
    number_type type;
    int dimensions;                          /* 1 .. ARRAY_VIEW_DIMENSIONS */
    size_t size[ARRAY_VIEW_DIMENSIONS];      /* along each axis */
    ptrdiff_t stride[ARRAY_VIEW_DIMENSIONS]; /* bytes from an element to the next one; may be negative */
    const volatile sig_atomic_t *stop;       /* once it is set, readers fail (cancelled); NULL: they do not */
} array_view;

static inline const void *array_view_at(const array_view *a, size_t i, size_t j)
{
    return (const char *)a->data + (ptrdiff_t)i * a->stride[0] + (ptrdiff_t)j * a->stride[1];
}

static inline bool array_view_stopped(const array_view *a)
{
    return a->stop && __atomic_load_n(a->stop, __ATOMIC_RELAXED);
}

static inline double array_view_number(const array_view *a, size_t i, size_t j)
{
    return number_value(array_view_at(a, i, j), a->type, false);
}

/* An element of an integer array. */
static inline int64_t array_view_whole(const array_view *a, size_t i, size_t j)
{
    return number_whole(array_view_at(a, i, j), a->type, false);
}

#endif
