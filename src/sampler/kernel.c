#include "sampler/kernel.h"

#include <math.h>
#include <stdbool.h>
#ifdef __x86_64__
#include <immintrin.h>
#endif

enum { LANES = 16 };

/* w cot w for q = w^2, w in [0, pi/2]: least squares on Chebyshev nodes, within 5e-8; with rounding 2e-7. In
 * Estrin's order, since the next particle waits for this one. */
ISA_INLINE float wcotw(float q)
{
    float q2 = q * q, q4 = q2 * q2;
    float low = (9.99999958e-01f - 3.33331684e-01f * q) - (2.22326308e-02f + 2.09201489e-03f * q) * q2;
    return low - ((2.38374932e-04f + 6.85017157e-06f * q) + 5.74249429e-06f * q2) * q4;
}

/* Of the support: nearer ones are taken to be as near. */
static const float CLOSEST = 1e-4f;

/* Sums of a block's lanes, kept apart until the end. */
typedef struct sums {
    float energy[LANES], d1[LANES], d2[LANES], h11[LANES], h12[LANES], h22[LANES], nearest2[LANES];
} sums;

/* The places of up to LANES neighbours; the first stands in for those that are missing. */
typedef struct block {
    _Alignas(64) int32_t x[LANES];
    int32_t y[LANES], z[LANES];
    float size[LANES];
} block;

ISA_INLINE void load_portable(const neighbours_place *place, const uint32_t *list, size_t count, block *out)
{
    for (size_t l = 0; l < LANES; l++) {
        const neighbours_place *p = &place[list[l < count ? l : 0]];
        out->x[l] = p->x;
        out->y[l] = p->y;
        out->z[l] = p->z;
        out->size[l] = p->size;
    }
}

#ifdef __x86_64__
/* Place by place, and turned in registers: a vector that is read where numbers were written one by one waits
 * until all of them are in the cache. */
ISA_TARGET_AVX512 static inline __attribute__((always_inline)) void
load_avx512(const neighbours_place *place, const uint32_t *list, size_t count, block *out)
{
    __m512i p[4];
    for (size_t k = 0; k < 4; k++) { /* neighbours k, 4 + k, 8 + k, 12 + k */
        __m128i four[4];
        for (size_t q = 0; q < 4; q++)
            four[q] = _mm_loadu_si128((const __m128i *)&place[list[4 * q + k < count ? 4 * q + k : 0]]);
        p[k] = _mm512_inserti32x4(_mm512_castsi128_si512(four[0]), four[1], 1);
        p[k] = _mm512_inserti32x4(p[k], four[2], 2);
        p[k] = _mm512_inserti32x4(p[k], four[3], 3);
    }
    __m512i xy01 = _mm512_unpacklo_epi32(p[0], p[1]), xy23 = _mm512_unpacklo_epi32(p[2], p[3]),
            zs01 = _mm512_unpackhi_epi32(p[0], p[1]), zs23 = _mm512_unpackhi_epi32(p[2], p[3]);
    _mm512_store_si512(out->x, _mm512_unpacklo_epi64(xy01, xy23));
    _mm512_store_si512(out->y, _mm512_unpackhi_epi64(xy01, xy23));
    _mm512_store_si512(out->z, _mm512_unpacklo_epi64(zs01, zs23));
    _mm512_store_si512(out->size, _mm512_unpackhi_epi64(zs01, zs23));
}

ISA_TARGET_AVX2 static inline __attribute__((always_inline)) void
load_avx2(const neighbours_place *place, const uint32_t *list, size_t count, block *out)
{
    for (size_t half = 0; half < LANES; half += 8) {
        __m256i p[4];
        for (size_t k = 0; k < 4; k++) { /* neighbours k and 4 + k */
            size_t a = half + k, b = half + 4 + k;
            __m128i low = _mm_loadu_si128((const __m128i *)&place[list[a < count ? a : 0]]),
                    high = _mm_loadu_si128((const __m128i *)&place[list[b < count ? b : 0]]);
            p[k] = _mm256_inserti128_si256(_mm256_castsi128_si256(low), high, 1);
        }
        __m256i xy01 = _mm256_unpacklo_epi32(p[0], p[1]), xy23 = _mm256_unpacklo_epi32(p[2], p[3]),
                zs01 = _mm256_unpackhi_epi32(p[0], p[1]), zs23 = _mm256_unpackhi_epi32(p[2], p[3]);
        _mm256_store_si256((__m256i *)(out->x + half), _mm256_unpacklo_epi64(xy01, xy23));
        _mm256_store_si256((__m256i *)(out->y + half), _mm256_unpackhi_epi64(xy01, xy23));
        _mm256_store_si256((__m256i *)(out->z + half), _mm256_unpacklo_epi64(zs01, zs23));
        _mm256_store_si256((__m256i *)(out->size + half), _mm256_unpackhi_epi64(zs01, zs23));
    }
}
#else
#define load_avx2 load_portable
#define load_avx512 load_portable
#endif

/* Adds the first `count` of a block; the first block sets the sums. */
ISA_INLINE void add_block(bool first, const block *b, size_t count, neighbours_place own,
                          const float axis1[3], const float axis2[3], float support, sums *out)
{
    const float reach = (float)M_PI / support, farthest = (float)(M_PI_2 * M_PI_2);
    const float nearest = farthest * CLOSEST * CLOSEST;
    const float half_own = 0.5f / own.size, own_scale = reach * half_own, stiffness = own_scale * own_scale;
    float have[LANES];
    for (int l = 0; l < LANES; l++) have[l] = l < (int)count ? 1.0f : 0.0f;
    for (int l = 0; l < LANES; l++) {
        float dx = (float)(own.x - b->x[l]), dy = (float)(own.y - b->y[l]), dz = (float)(own.z - b->z[l]);
        float sizes = own.size + b->size[l], scale = reach / sizes; /* distance to w = u pi / 2 */
        float r2 = dx * dx + dy * dy + dz * dz, q = r2 * (scale * scale);
        float inside = q < farthest ? have[l] : 0.0f, far2 = inside > 0 ? r2 : INFINITY;
        q = q < farthest ? q : farthest;
        q = q > nearest ? q : nearest;
        float w = sqrtf(q), over = 1 / w, cot = wcotw(q) * over;
        float cot2 = cot * cot, weight = inside * stiffness, share = sizes * half_own;
        float slope = -cot2 * over * weight;                                          /* phi' / r */
        float bend = 2 * cot * (1 + cot2) * (over * over) * (scale * scale) * weight; /* phi'' / r^2 */
        float a1 = dx * axis1[0] + dy * axis1[1] + dz * axis1[2];
        float a2 = dx * axis2[0] + dy * axis2[1] + dz * axis2[2];
        float energy = inside * (share * share) * (cot + w - (float)M_PI_2);
        out->energy[l] = first ? energy : out->energy[l] + energy;
        out->d1[l] = first ? slope * a1 : out->d1[l] + slope * a1;
        out->d2[l] = first ? slope * a2 : out->d2[l] + slope * a2;
        out->h11[l] = first ? bend * a1 * a1 : out->h11[l] + bend * a1 * a1;
        out->h12[l] = first ? bend * a1 * a2 : out->h12[l] + bend * a1 * a2;
        out->h22[l] = first ? bend * a2 * a2 : out->h22[l] + bend * a2 * a2;
        out->nearest2[l] = first || far2 < out->nearest2[l] ? far2 : out->nearest2[l];
    }
}

/* A fixed tree of additions, whatever the vectors' width. */
ISA_INLINE float fold(float *a)
{
    for (int l = 0; l < 8; l++) a[l] += a[l + 8];
    for (int l = 0; l < 4; l++) a[l] += a[l + 4];
    return (a[0] + a[2]) + (a[1] + a[3]);
}

ISA_INLINE float fold_least(float *a)
{
    for (int width = LANES / 2; width > 0; width /= 2)
        for (int l = 0; l < width; l++) a[l] = a[l + width] < a[l] ? a[l + width] : a[l];
    return a[0];
}

ISA_INLINE void fold_sums(sums *s, kernel_forces *out)
{
    *out = (kernel_forces){fold(s->energy), fold(s->d1),  fold(s->d2),         fold(s->h11),
                           fold(s->h12),    fold(s->h22), fold_least(s->nearest2)};
}

#define VERSION(name, target, load)                                                                          \
    target static void name(const neighbours_place *place, const uint32_t *list, size_t count,               \
                            neighbours_place own, const float axis1[3], const float axis2[3], float support, \
                            kernel_forces *out)                                                              \
    {                                                                                                        \
        block b;                                                                                             \
        sums s;                                                                                              \
        *out = (kernel_forces){.nearest2 = INFINITY};                                                        \
        if (count == 0) return;                                                                              \
        load(place, list, count, &b);                                                                        \
        add_block(true, &b, count, own, axis1, axis2, support, &s);                                          \
        for (size_t k = LANES; k < count; k += LANES) {                                                      \
            load(place, list + k, count - k, &b);                                                            \
            add_block(false, &b, count - k, own, axis1, axis2, support, &s);                                 \
        }                                                                                                    \
        fold_sums(&s, out);                                                                                  \
    }
VERSION(forces_portable, , load_portable)
VERSION(forces_avx2, ISA_TARGET_AVX2, load_avx2)
VERSION(forces_avx512, ISA_TARGET_AVX512, load_avx512)

kernel kernel_for(isa which)
{
    static const kernel versions[ISA_COUNT] = {forces_portable, forces_avx2, forces_avx512};
    return versions[which];
}
