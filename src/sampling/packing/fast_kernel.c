// SPDX-License-Identifier: Apache-2.0
#include "sampling/packing/fast_kernel.h"

#include <math.h>
#include <stddef.h>
#include <string.h>
#ifdef __x86_64__
#include <immintrin.h>
#endif

#include "sampling/packing/pair.h"

enum { LANES = FAST_KERNEL_LANES };

/* Added to w^2, so that coincident particles have a positive distance. At the support w^2 is 2.47; except for
 * coincident particles the addition is below the rounding error. */
static const float CLOSEST = 2.5e-10f;
/* The derivative of a facing weight is multiplied by the potential of the pair, at most by this value: that
 * at 1/20 of the support. The potential of coincident particles is infinite. */
static const float TURNING_MOST = 11.24f;

/* The damped Newton step (11)(12) in the tangent plane. It is scaled by omega, and shortened to the share
 * FAST_KERNEL_BOUND_SHARE of limit2. Each loop here and in `project` has numbers of one type only, so that
 * the compiler vectorises it; is_valid is therefore set by a second loop. */
ISA_INLINE void tangent_step(const fast_kernel_particles *own, const fast_kernel_forces *f,
                             const fast_kernel_params *params, fast_kernel_step *out)
{
    const double unit2 = params->unit * params->unit, scale0 = params->omega * params->unit;
    double is_valid[LANES];
    for (int l = 0; l < LANES; l++) {
        double h11 = (double)f->h11[l], h12 = (double)f->h12[l], h22 = (double)f->h22[l];
        double d1 = (double)f->d1[l], d2 = (double)f->d2[l], size = (double)own->size[l];
        double floor = FAST_KERNEL_HESSIAN_FLOOR * (h11 + h22), stiffer = 1 + (double)own->damping[l];
        double a = h11 * stiffer + floor, c = h22 * stiffer + floor;
        double determinant = a * c - h12 * h12;
        double over = determinant > 0 ? 1 / determinant : 0;
        double s1 = (h12 * d2 - c * d1) * over, s2 = (h12 * d1 - a * d2) * over;
        out->gain[l] = -0.5 * (s1 * d1 + s2 * d2);
        double allowed_step = (double)own->allowed_step[l], limit2 = (double)f->nearest2[l] * unit2;
        limit2 = limit2 < allowed_step * allowed_step ? limit2 : allowed_step * allowed_step;
        double bound2 = FAST_KERNEL_BOUND_SHARE * FAST_KERNEL_BOUND_SHARE * limit2;
        double length2 = scale0 * scale0 * (s1 * s1 + s2 * s2);
        double scale = length2 > bound2 ? scale0 * sqrt(bound2 / length2) : scale0;
        double longest = params->longest * size;
        length2 = length2 > bound2 ? bound2 : length2;
        s1 *= scale;
        s2 *= scale;
        out->end.x[l] = own->position.x[l] + (s1 * (double)f->axis1[0][l] + s2 * (double)f->axis2[0][l]);
        out->end.y[l] = own->position.y[l] + (s1 * (double)f->axis1[1][l] + s2 * (double)f->axis2[1][l]);
        out->end.z[l] = own->position.z[l] + (s1 * (double)f->axis1[2][l] + s2 * (double)f->axis2[2][l]);
        out->limit2[l] = limit2;
        is_valid[l] = length2 <= longest * longest ? 1.0 : 0.0;
    }
    for (int l = 0; l < LANES; l++) out->is_valid[l] = is_valid[l] > 0;
}

/* One Newton step (9) along the gradient onto the surface. */
ISA_INLINE void project(const fast_kernel_particles *own, const fast_kernel_params *params,
                        fast_kernel_step *step)
{
    double is_valid[LANES];
    for (int l = 0; l < LANES; l++) {
        double gx = step->gradient.x[l], gy = step->gradient.y[l], gz = step->gradient.z[l];
        double value = step->value[l], g2 = gx * gx + gy * gy + gz * gz;
        double farthest = params->farthest * (double)own->size[l];
        double over = 1 / sqrt(g2), back = value * over * over; /* the step is -back times the gradient */
        double x = step->end.x[l] - back * gx, y = step->end.y[l] - back * gy, z = step->end.z[l] - back * gz;
        double dx = x - own->position.x[l], dy = y - own->position.y[l], dz = z - own->position.z[l];
        double length2 = dx * dx + dy * dy + dz * dz;
        double near = value * value < farthest * farthest * g2 ? 1.0 : 0.0;
        is_valid[l] = length2 <= step->limit2[l] ? near : 0.0;
        step->length[l] = sqrt(length2);
        step->end.x[l] = x;
        step->end.y[l] = y;
        step->end.z[l] = z;
        step->gradient.x[l] = gx * over;
        step->gradient.y[l] = gy * over;
        step->gradient.z[l] = gz * over;
    }
    for (int l = 0; l < LANES; l++) step->is_valid[l] &= is_valid[l] > 0;
}

/* The argument of the cotangent is w = pi/2 r / (support times the mean of the two sizes). Returns w of a
 * pair at the distance of one unit of place whose sizes add up to 1. */
ISA_INLINE float angle_of_unit(const fast_kernel_params *params)
{
    return (float)(M_PI * params->unit / params->support);
}

#define VERSION(name) name##_portable
#define VERSION_WIDTH 4
#define VERSION_MIN(a, b) VERSION_SELECT((a) < (b), a, b)
#define VERSION_SQRT(x) ((VERSION(floats)){sqrtf((x)[0]), sqrtf((x)[1]), sqrtf((x)[2]), sqrtf((x)[3])})
#include "sampling/packing/fast_kernel_pairs.h"
ISA_INLINE void load_portable(const void *from, const uint32_t *const list[], size_t k, entries_portable *out)
{
    int32_t e[VERSION_WIDTH][4];
    for (int l = 0; l < VERSION_WIDTH; l++)
        memcpy(e[l], (const char *)from + sizeof e[l] * list[l][k], sizeof e[l]);
    out->x = (ints_portable){e[0][0], e[1][0], e[2][0], e[3][0]};
    out->y = (ints_portable){e[0][1], e[1][1], e[2][1], e[3][1]};
    out->z = (ints_portable){e[0][2], e[1][2], e[2][2], e[3][2]};
    out->rest = (ints_portable){e[0][3], e[1][3], e[2][3], e[3][3]};
}
#undef VERSION
#undef VERSION_WIDTH
#undef VERSION_MIN
#undef VERSION_SQRT

#ifdef __x86_64__
ISA_INLINE __m128i entry_at(const void *from, const uint32_t *list, size_t k)
{
    return _mm_loadu_si128((const __m128i *)from + list[k]);
}

#pragma GCC push_options
#pragma GCC target("avx2")
#define VERSION(name) name##_avx2
#define VERSION_WIDTH 8
#define VERSION_MIN(a, b) ((VERSION(floats))_mm256_min_ps((__m256)(a), (__m256)(b)))
#define VERSION_SQRT(x) ((VERSION(floats))_mm256_sqrt_ps((__m256)(x)))
#include "sampling/packing/fast_kernel_pairs.h"
/* Loads entry k of eight lists and transposes the eight structs to four vectors in registers. */
ISA_INLINE void load_avx2(const void *from, const uint32_t *const list[], size_t k, entries_avx2 *out)
{
    __m256i p[4];
    for (size_t q = 0; q < 4; q++) { /* lanes q and 4 + q */
        p[q] = _mm256_castsi128_si256(entry_at(from, list[q], k));
        p[q] = _mm256_inserti128_si256(p[q], entry_at(from, list[4 + q], k), 1);
    }
    const __m256i xy01 = _mm256_unpacklo_epi32(p[0], p[1]), xy23 = _mm256_unpacklo_epi32(p[2], p[3]),
                  zs01 = _mm256_unpackhi_epi32(p[0], p[1]), zs23 = _mm256_unpackhi_epi32(p[2], p[3]);
    out->x = (ints_avx2)_mm256_unpacklo_epi64(xy01, xy23);
    out->y = (ints_avx2)_mm256_unpackhi_epi64(xy01, xy23);
    out->z = (ints_avx2)_mm256_unpacklo_epi64(zs01, zs23);
    out->rest = (ints_avx2)_mm256_unpackhi_epi64(zs01, zs23);
}
#undef VERSION
#undef VERSION_WIDTH
#undef VERSION_MIN
#undef VERSION_SQRT
#pragma GCC pop_options

#pragma GCC push_options
#pragma GCC target("avx512f,avx512dq,avx512vl,prefer-vector-width=512")
#define VERSION(name) name##_avx512
#define VERSION_WIDTH 16
#define VERSION_MIN(a, b) ((VERSION(floats))_mm512_min_ps((__m512)(a), (__m512)(b)))
#define VERSION_SQRT(x) ((VERSION(floats))_mm512_sqrt_ps((__m512)(x)))
#include "sampling/packing/fast_kernel_pairs.h"
ISA_INLINE void load_avx512(const void *from, const uint32_t *const list[], size_t k, entries_avx512 *out)
{
    __m512i p[4];
    for (size_t q = 0; q < 4; q++) { /* lanes q, 4 + q, 8 + q, 12 + q */
        p[q] = _mm512_castsi128_si512(entry_at(from, list[q], k));
        p[q] = _mm512_inserti32x4(p[q], entry_at(from, list[4 + q], k), 1);
        p[q] = _mm512_inserti32x4(p[q], entry_at(from, list[8 + q], k), 2);
        p[q] = _mm512_inserti32x4(p[q], entry_at(from, list[12 + q], k), 3);
    }
    const __m512i xy01 = _mm512_unpacklo_epi32(p[0], p[1]), xy23 = _mm512_unpacklo_epi32(p[2], p[3]),
                  zs01 = _mm512_unpackhi_epi32(p[0], p[1]), zs23 = _mm512_unpackhi_epi32(p[2], p[3]);
    out->x = (ints_avx512)_mm512_unpacklo_epi64(xy01, xy23);
    out->y = (ints_avx512)_mm512_unpackhi_epi64(xy01, xy23);
    out->z = (ints_avx512)_mm512_unpacklo_epi64(zs01, zs23);
    out->rest = (ints_avx512)_mm512_unpackhi_epi64(zs01, zs23);
}
#pragma GCC pop_options
#else
#define version_avx2 version_portable
#define version_avx512 version_portable
#endif

const fast_kernel *fast_kernel_for(isa which)
{
    static const fast_kernel *const versions[ISA_COUNT] = {&version_portable, &version_avx2, &version_avx512};
    return versions[which];
}
