// SPDX-License-Identifier: Apache-2.0
/* lanes: vectors of eight floats, one instruction where the processor has 256-bit vectors. For functions
 * marked ISA_CLONES and functions inlined into these; results of all versions are bitwise equal.
 */
#ifndef HEXAD_BASE_CORE_LANES_H
#define HEXAD_BASE_CORE_LANES_H

#include <math.h>
#include <stdint.h>

#include "base/core/isa.h"

enum { LANES = 8 };

/* Any alignment of float is permitted. A mask has -1 in lanes where a condition is true, and 0 in others. */
typedef float lanes __attribute__((vector_size(4 * LANES), aligned(4), may_alias));
typedef int32_t lanes_mask __attribute__((vector_size(4 * LANES)));

#pragma GCC diagnostic ignored "-Wpsabi" /* all functions with lanes as parameters or results are inlined */

/* A mask from eight bits, one per lane. */
ISA_INLINE lanes_mask lanes_spread(uint8_t bits)
{
    const lanes_mask bit = {1, 2, 4, 8, 16, 32, 64, 128}, all = {0};
    return ((all + (int32_t)bits) & bit) == bit;
}

ISA_INLINE lanes lanes_all(float value)
{
    return (lanes){0} + value;
}

/* a where the mask is set, 0 in other lanes. */
ISA_INLINE lanes lanes_only(lanes_mask of, lanes a)
{
    return (lanes)(of & (lanes_mask)a);
}

/* a where the mask is set, b in other lanes. */
ISA_INLINE lanes lanes_chosen(lanes_mask of, lanes a, lanes b)
{
    return (lanes)((of & (lanes_mask)a) | (~of & (lanes_mask)b));
}

/* A loop that is not unrolled early compiles to a single instruction. */
ISA_INLINE lanes lanes_smaller(lanes a, lanes b)
{
#pragma GCC unroll 1
    for (int k = 0; k < LANES; k++) a[k] = a[k] < b[k] ? a[k] : b[k];
    return a;
}

ISA_INLINE lanes lanes_larger(lanes a, lanes b)
{
#pragma GCC unroll 1
    for (int k = 0; k < LANES; k++) a[k] = a[k] > b[k] ? a[k] : b[k];
    return a;
}

ISA_INLINE lanes lanes_root(lanes a)
{
#pragma GCC unroll 1
    for (int k = 0; k < LANES; k++) a[k] = sqrtf(a[k]);
    return a;
}

ISA_INLINE lanes lanes_magnitude(lanes a)
{
    return (lanes)((lanes_mask)a & INT32_MAX);
}

/* The magnitude of a with the sign of b. */
ISA_INLINE lanes lanes_signed(lanes a, lanes b)
{
    return (lanes)(((lanes_mask)a & INT32_MAX) | ((lanes_mask)b & INT32_MIN));
}

/* Transposes: lane i of r[j] becomes lane j of r[i]. */
ISA_INLINE void lanes_transpose(lanes r[LANES])
{
#pragma GCC unroll 3
    for (int step = 0; step < 3; step++) { /* a perfect shuffle of 64 values, three times, is the transpose */
        lanes to[LANES];
#pragma GCC unroll 4
        for (int k = 0; k < LANES / 2; k++) {
            const lanes a = r[k], b = r[k + LANES / 2];
            to[2 * k] = __builtin_shufflevector(a, b, 0, 8, 1, 9, 2, 10, 3, 11);
            to[2 * k + 1] = __builtin_shufflevector(a, b, 4, 12, 5, 13, 6, 14, 7, 15);
        }
#pragma GCC unroll 8
        for (int k = 0; k < LANES; k++) r[k] = to[k];
    }
}

#endif
