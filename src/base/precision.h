/* precision: which numbers doubles and floats hold. Pure functions; any thread. */
#ifndef HEXAD_BASE_PRECISION_H
#define HEXAD_BASE_PRECISION_H

#include <stdint.h>

/* 2^53 - 1: every whole number up to this one, of either sign, is a double, and no other number becomes the same double. */
#define PRECISION_WHOLE_MOST INT64_C(9007199254740991)

/* The value in single precision. Through memory: gcc 12 at -O3 drops the two conversions when it puts values into one vector. */
static inline double precision_as_float(double value)
{
    volatile float single = (float)value;
    return (double)single;
}

#endif
