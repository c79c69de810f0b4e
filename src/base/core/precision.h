// SPDX-License-Identifier: Apache-2.0
/* precision: the range of whole numbers in doubles, and rounding to floats. Pure functions, any thread. */
#ifndef HEXAD_BASE_CORE_PRECISION_H
#define HEXAD_BASE_CORE_PRECISION_H

#include <stdint.h>

/* 2^53 - 1: all integers up to this magnitude are doubles, and no other number rounds to the same double. */
#define PRECISION_WHOLE_MOST INT64_C(9007199254740991)

/* The value rounded to single precision. Through memory: gcc 12 at -O3 drops the two conversions when it
 * vectorises them. */
static inline double precision_as_float(double value)
{
    volatile float single = (float)value;
    return (double)single;
}

#endif
