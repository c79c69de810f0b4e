// SPDX-License-Identifier: Apache-2.0
#include "surface/field/spline.h"

#include <string.h>
#ifdef __x86_64__
#include <immintrin.h>
#endif

/* Arithmetic is in doubles for coefficients of both types, except in `gradient_lanes`. In floats the rounding
 * noise of the value is 1e-7 of the coefficients. That is sufficient for fast steps, which do not compare
 * energies. A minimiser that compares energies to ten digits is disturbed by it. */
typedef double lanes __attribute__((vector_size(32)));
typedef float narrow __attribute__((vector_size(16)));

/* The coefficients of a cell: one of the two pointers is not NULL. It is a compile-time constant where the
 * functions below are inlined. */
typedef struct support {
    const float *single;
    const double *wide;
    size_t row, slab;
} support;

/* Coefficients of t^k, k = 0 to 3, of the four weights along an axis, and of their derivatives. */
typedef struct cubic {
    narrow value, slope;
} cubic;
static const cubic weight_cubics[4] = {{{1.0f / 6, 4.0f / 6, 1.0f / 6, 0}, {-0.5f, 0, 0.5f, 0}},
                                       {{-0.5f, 0, 0.5f, 0}, {1, -2, 1, 0}},
                                       {{0.5f, -1, 0.5f, 0}, {-0.5f, 1.5f, -1.5f, 0.5f}},
                                       {{-1.0f / 6, 0.5f, -0.5f, 1.0f / 6}, {0, 0, 0, 0}}};

#define VERSION(name) name##_portable
#define VERSION_WIDEN(n) __builtin_convertvector(n, lanes)
#define VERSION_ROWS 1
#include "surface/field/spline_cell.h"
#undef VERSION
#undef VERSION_WIDEN
#undef VERSION_ROWS

#ifdef __x86_64__
#pragma GCC push_options
#pragma GCC target("avx2")
#define VERSION(name) name##_avx2
#define VERSION_WIDEN(n) \
    ((lanes)_mm256_cvtps_pd((__m128)(n))) /* the compiler needs five instructions for the generic form */
#define VERSION_ROWS 2
#include "surface/field/spline_cell.h"
#undef VERSION
#undef VERSION_WIDEN
#undef VERSION_ROWS
#pragma GCC pop_options

/* The rows of a cell have four coefficients: wider vectors bring nothing. AVX-512 has twice as many
 * registers, which hold the weights. */
#pragma GCC push_options
#pragma GCC target("avx512f,avx512dq,avx512vl,prefer-vector-width=256")
#define VERSION(name) name##_avx512
#define VERSION_WIDEN(n) ((lanes)_mm256_cvtps_pd((__m128)(n)))
#define VERSION_ROWS 2
#include "surface/field/spline_cell.h"
#undef VERSION
#undef VERSION_WIDEN
#undef VERSION_ROWS
#pragma GCC pop_options
#else
#define version_avx2 version_portable
#define version_avx512 version_portable
#endif

const spline *spline_for(isa which)
{
    static const spline *const versions[ISA_COUNT] = {&version_portable, &version_avx2, &version_avx512};
    return versions[which];
}
