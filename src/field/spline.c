#include "field/spline.h"

#include <string.h>
#ifdef __x86_64__
#include <immintrin.h>
#endif

/* The arithmetic is in doubles whatever the coefficients are. In floats it is a quarter faster, but the
 * value then jitters by some 1e-7 of the coefficients, and a minimiser that compares energies to ten
 * digits and differences of values sees that jitter. */
typedef double lanes __attribute__((vector_size(32)));
typedef float narrow __attribute__((vector_size(16)));

/* The coefficients of a cell: one of the two pointers. A constant where the functions below are expanded, so
 * that nothing is decided at run time. */
typedef struct support {
    const float *single;
    const double *wide;
    size_t row, slab;
} support;

#define VERSION(name) name##_portable
#define VERSION_WIDEN(n) __builtin_convertvector(n, lanes)
#include "field/spline_cell.h"
#undef VERSION
#undef VERSION_WIDEN

#ifdef __x86_64__
#pragma GCC push_options
#pragma GCC target("avx2")
#define VERSION(name) name##_avx2
#define VERSION_WIDEN(n) \
    ((lanes)_mm256_cvtps_pd((__m128)(n))) /* the compiler makes five instructions of it */
#include "field/spline_cell.h"
#undef VERSION
#undef VERSION_WIDEN
#pragma GCC pop_options

/* A cell's rows have four coefficients: wider vectors have nothing to hold. But there are twice as many, so
 * that the weights stay in them. */
#pragma GCC push_options
#pragma GCC target("avx512f,avx512dq,avx512vl,prefer-vector-width=256")
#define VERSION(name) name##_avx512
#define VERSION_WIDEN(n) ((lanes)_mm256_cvtps_pd((__m128)(n)))
#include "field/spline_cell.h"
#undef VERSION
#undef VERSION_WIDEN
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
