#include "field/spline.h"

#include <string.h>
#ifdef __x86_64__
#include <immintrin.h>
#endif

/* The arithmetic is in doubles whatever the coefficients are, but for lanes. In floats the value jitters by some
 * 1e-7 of the coefficients: fast steps, which do not look at energies, are none the worse, but a minimiser that
 * compares energies to ten digits and differences of values sees that jitter. */
typedef double lanes __attribute__((vector_size(32)));
typedef float narrow __attribute__((vector_size(16)));

/* The coefficients of a cell: one of the two pointers. A constant where the functions below are expanded, so
 * that nothing is decided at run time. */
typedef struct support {
    const float *single;
    const double *wide;
    size_t row, slab;
} support;

/* Coefficients of t^k, k = 0 to 3, of a particle's four weights along an axis, and of their derivatives. */
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
#include "field/spline_cell.h"
#undef VERSION
#undef VERSION_WIDEN
#undef VERSION_ROWS

#ifdef __x86_64__
#pragma GCC push_options
#pragma GCC target("avx2")
#define VERSION(name) name##_avx2
#define VERSION_WIDEN(n) \
    ((lanes)_mm256_cvtps_pd((__m128)(n))) /* the compiler makes five instructions of it */
#define VERSION_ROWS 2
#include "field/spline_cell.h"
#undef VERSION
#undef VERSION_WIDEN
#undef VERSION_ROWS
#pragma GCC pop_options

/* A cell's rows have four coefficients: wider vectors have nothing to hold. But there are twice as many, so
 * that the weights stay in them. */
#pragma GCC push_options
#pragma GCC target("avx512f,avx512dq,avx512vl,prefer-vector-width=256")
#define VERSION(name) name##_avx512
#define VERSION_WIDEN(n) ((lanes)_mm256_cvtps_pd((__m128)(n)))
#define VERSION_ROWS 2
#include "field/spline_cell.h"
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
