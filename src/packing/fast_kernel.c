#include "packing/fast_kernel.h"

#include <math.h>
#include <stddef.h>
#ifdef __x86_64__
#include <immintrin.h>
#endif

#include "packing/pair.h"

enum { LANES = FAST_KERNEL_LANES };

/* w cot w for q = w^2, w in [0, pi/2]: least squares on Chebyshev nodes, within 5e-8; with rounding 2e-7. In
 * Estrin's order, which has the shortest chain. */
ISA_INLINE float wcotw(float q)
{
    float q2 = q * q, q4 = q2 * q2;
    float low = (9.99999958e-01f - 3.33331684e-01f * q) - (2.22326308e-02f + 2.09201489e-03f * q) * q2;
    return low - ((2.38374932e-04f + 6.85017157e-06f * q) + 5.74249429e-06f * q2) * q4;
}

/* Of the support: nearer ones are taken to be as near. */
static const float CLOSEST = 1e-4f;
/* The potential of a neighbour at a twentieth of the support, and no more, scales what the turning of normals adds. */
static const float TURNING_MOST = 11.24f;

/* The places of one neighbour of each particle; or its normal, in the first three as floats. */
typedef struct row {
    union {
        _Alignas(64) int32_t x[LANES];
        float nx[LANES];
    };
    union {
        int32_t y[LANES];
        float ny[LANES];
    };
    union {
        int32_t z[LANES];
        float nz[LANES];
    };
    float size[LANES];
} row;

/* What a row is loaded from: the one that is not NULL. A constant where the functions below are expanded. */
typedef struct source {
    const neighbours_place *place;
    const fast_kernel_normal *normal;
} source;

ISA_INLINE void load_portable(source from, const uint32_t *const list[], size_t k, size_t lanes, row *out)
{
    for (size_t l = 0; from.place && l < lanes; l++) {
        const neighbours_place *p = &from.place[list[l][k]];
        out->x[l] = p->x;
        out->y[l] = p->y;
        out->z[l] = p->z;
        out->size[l] = p->size;
    }
    for (size_t l = 0; from.normal && l < lanes; l++) {
        const fast_kernel_normal *n = &from.normal[list[l][k]];
        out->nx[l] = n->x;
        out->ny[l] = n->y;
        out->nz[l] = n->z;
    }
}

#ifdef __x86_64__
ISA_INLINE __m128i four_at(source from, const uint32_t *list, size_t k)
{
    const void *at = from.place ? (const void *)&from.place[list[k]] : &from.normal[list[k]];
    return _mm_loadu_si128(at);
}

/* Place by place, and turned in registers: a vector that is read where numbers were written one by one waits
 * until all of them are in the cache. */
ISA_TARGET_AVX2 static inline __attribute__((always_inline)) void
load_avx2(source from, const uint32_t *const list[], size_t k, size_t lanes, row *out)
{
    for (size_t half = 0; half < lanes; half += 8) {
        __m256i p[4];
        for (size_t q = 0; q < 4; q++) { /* lanes q and 4 + q */
            p[q] = _mm256_castsi128_si256(four_at(from, list[half + q], k));
            p[q] = _mm256_inserti128_si256(p[q], four_at(from, list[half + 4 + q], k), 1);
        }
        __m256i xy01 = _mm256_unpacklo_epi32(p[0], p[1]), xy23 = _mm256_unpacklo_epi32(p[2], p[3]),
                zs01 = _mm256_unpackhi_epi32(p[0], p[1]), zs23 = _mm256_unpackhi_epi32(p[2], p[3]);
        _mm256_store_si256((__m256i *)(out->x + half), _mm256_unpacklo_epi64(xy01, xy23));
        _mm256_store_si256((__m256i *)(out->y + half), _mm256_unpackhi_epi64(xy01, xy23));
        _mm256_store_si256((__m256i *)(out->z + half), _mm256_unpacklo_epi64(zs01, zs23));
        _mm256_store_si256((__m256i *)(out->size + half), _mm256_unpackhi_epi64(zs01, zs23));
    }
}

ISA_TARGET_AVX512 static inline __attribute__((always_inline)) void
load_avx512(source from, const uint32_t *const list[], size_t k, size_t lanes, row *out)
{
    if (lanes < LANES) {
        load_avx2(from, list, k, lanes, out);
        return;
    }
    __m512i p[4];
    for (size_t q = 0; q < 4; q++) { /* lanes q, 4 + q, 8 + q, 12 + q */
        p[q] = _mm512_castsi128_si512(four_at(from, list[q], k));
        p[q] = _mm512_inserti32x4(p[q], four_at(from, list[4 + q], k), 1);
        p[q] = _mm512_inserti32x4(p[q], four_at(from, list[8 + q], k), 2);
        p[q] = _mm512_inserti32x4(p[q], four_at(from, list[12 + q], k), 3);
    }
    __m512i xy01 = _mm512_unpacklo_epi32(p[0], p[1]), xy23 = _mm512_unpacklo_epi32(p[2], p[3]),
            zs01 = _mm512_unpackhi_epi32(p[0], p[1]), zs23 = _mm512_unpackhi_epi32(p[2], p[3]);
    _mm512_store_si512(out->x, _mm512_unpacklo_epi64(xy01, xy23));
    _mm512_store_si512(out->y, _mm512_unpackhi_epi64(xy01, xy23));
    _mm512_store_si512(out->z, _mm512_unpacklo_epi64(zs01, zs23));
    _mm512_store_si512(out->size, _mm512_unpackhi_epi64(zs01, zs23));
}
#else
#define load_avx2 load_portable
#define load_avx512 load_portable
#endif

/* What follows from each particle's size. */
typedef struct scales {
    float half_own[LANES], stiffness[LANES];
    float nx[LANES], ny[LANES], nz[LANES]; /* the normals */
} scales;

/* The frames of vec3_frame, in single precision; no forces yet. */
ISA_INLINE void set_up(const fast_kernel_particles *own, float reach, scales *s, fast_kernel_forces *out)
{
    for (int l = 0; l < LANES; l++) {
        float x = (float)own->normal.x[l], y = (float)own->normal.y[l], z = (float)own->normal.z[l];
        float sign = z < 0 ? -1.0f : 1.0f, a = -1 / (sign + z), b = x * y * a;
        out->axis1[0][l] = 1 + sign * x * x * a;
        out->axis1[1][l] = sign * b;
        out->axis1[2][l] = -sign * x;
        out->axis2[0][l] = b;
        out->axis2[1][l] = sign + y * y * a;
        out->axis2[2][l] = -y;
        s->nx[l] = x;
        s->ny[l] = y;
        s->nz[l] = z;
        s->half_own[l] = 0.5f / own->size[l];
        s->stiffness[l] = (reach * s->half_own[l]) * (reach * s->half_own[l]);
        out->energy[l] = out->d1[l] = out->d2[l] = out->h11[l] = out->h12[l] = out->h22[l] = 0;
        out->turning[0][l] = out->turning[1][l] = out->turning[2][l] = 0;
        out->nearest2[l] = INFINITY;
    }
}

/* As in pair_weigh: t, the weight as a function of it, and what the weight grows by with the cosine. */
ISA_INLINE float facing_share(float cosine)
{
    float t = (cosine - (float)PAIR_FACING_NONE) * (float)(1 / PAIR_FACING_RANGE);
    t = t < 0 ? 0 : t;
    return t > 1 ? 1 : t;
}

ISA_INLINE float facing_weight(float t)
{
    return t * t * (3 - 2 * t);
}

ISA_INLINE float facing_slope(float t)
{
    return 6 * t * (1 - t) * (float)(1 / PAIR_FACING_RANGE);
}

/* Adds neighbour k of each particle that has as many; `n` has the neighbours' normals, or is NULL where all count in full. */
ISA_INLINE void add_row(const row *b, const row *n, uint32_t k, const fast_kernel_particles *own,
                        const scales *s, float reach, fast_kernel_forces *out)
{
    const float farthest = (float)(M_PI_2 * M_PI_2), nearest = farthest * CLOSEST * CLOSEST;
    for (int l = 0; l < LANES; l++) {
        float dx = (float)(own->x[l] - b->x[l]), dy = (float)(own->y[l] - b->y[l]),
              dz = (float)(own->z[l] - b->z[l]);
        float sizes = own->size[l] + b->size[l], scale = reach / sizes; /* distance to w = u pi / 2 */
        float r2 = dx * dx + dy * dy + dz * dz, q = r2 * (scale * scale);
        float counts = (q < farthest) & (k < own->count[l]) ? 1.0f : 0.0f, bend_facing = 0;
        if (n) {
            float t = facing_share(s->nx[l] * n->nx[l] + s->ny[l] * n->ny[l] + s->nz[l] * n->nz[l]);
            bend_facing = counts * facing_slope(t);
            counts *= facing_weight(t);
        }
        float far2 = counts > 0 ? r2 : INFINITY;
        q = q < farthest ? q : farthest;
        q = q > nearest ? q : nearest;
        float w = sqrtf(q), over = 1 / w, cot = wcotw(q) * over;
        float cot2 = cot * cot, weight = counts * s->stiffness[l], share = sizes * s->half_own[l];
        float slope = -cot2 * over * weight;                                          /* phi' / r */
        float bend = 2 * cot * (1 + cot2) * (over * over) * (scale * scale) * weight; /* phi'' / r^2 */
        float a1 = dx * out->axis1[0][l] + dy * out->axis1[1][l] + dz * out->axis1[2][l];
        float a2 = dx * out->axis2[0][l] + dy * out->axis2[1][l] + dz * out->axis2[2][l];
        float potential = cot + w - (float)M_PI_2;
        out->energy[l] += counts * (share * share) * potential;
        if (n) {
            float pull =
                bend_facing * (share * share) * (potential < TURNING_MOST ? potential : TURNING_MOST);
            out->turning[0][l] += pull * n->nx[l];
            out->turning[1][l] += pull * n->ny[l];
            out->turning[2][l] += pull * n->nz[l];
        }
        out->d1[l] += slope * a1;
        out->d2[l] += slope * a2;
        out->h11[l] += bend * a1 * a1;
        out->h12[l] += bend * a1 * a2;
        out->h22[l] += bend * a2 * a2;
        out->nearest2[l] = far2 < out->nearest2[l] ? far2 : out->nearest2[l];
    }
}

/* The energies alone. */
ISA_INLINE void add_energy(const row *b, const row *n, uint32_t k, const fast_kernel_particles *own,
                           const scales *s, float reach, size_t lanes, float *out)
{
    const float farthest = (float)(M_PI_2 * M_PI_2), nearest = farthest * CLOSEST * CLOSEST;
    for (size_t l = 0; l < lanes; l++) {
        float dx = (float)(own->x[l] - b->x[l]), dy = (float)(own->y[l] - b->y[l]),
              dz = (float)(own->z[l] - b->z[l]);
        float sizes = own->size[l] + b->size[l], scale = reach / sizes, share = sizes * s->half_own[l];
        float q = (dx * dx + dy * dy + dz * dz) * (scale * scale);
        float counts = (q < farthest) & (k < own->count[l]) ? 1.0f : 0.0f;
        if (n)
            counts *=
                facing_weight(facing_share(s->nx[l] * n->nx[l] + s->ny[l] * n->ny[l] + s->nz[l] * n->nz[l]));
        q = q < farthest ? q : farthest;
        q = q > nearest ? q : nearest;
        float w = sqrtf(q), cot = wcotw(q) * (1 / w);
        out[l] += counts * (share * share) * (cot + w - (float)M_PI_2);
    }
}

/* (11)(12) in the tangent frame. */
ISA_INLINE void step(const fast_kernel_particles *own, const fast_kernel_forces *f,
                     const fast_kernel_params *params, fast_kernel_way *out)
{
    const double unit2 = params->unit * params->unit, scale0 = params->omega * params->unit;
    double well[LANES];
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
        out->to.x[l] = own->position.x[l] + (s1 * (double)f->axis1[0][l] + s2 * (double)f->axis2[0][l]);
        out->to.y[l] = own->position.y[l] + (s1 * (double)f->axis1[1][l] + s2 * (double)f->axis2[1][l]);
        out->to.z[l] = own->position.z[l] + (s1 * (double)f->axis1[2][l] + s2 * (double)f->axis2[2][l]);
        out->limit2[l] = limit2;
        well[l] = length2 <= longest * longest ? 1.0 : 0.0;
    }
    for (int l = 0; l < LANES; l++) out->ends_well[l] = well[l] > 0;
}

/* Loops of one kind of number each: the compiler makes vectors of those. */
ISA_INLINE void land(const fast_kernel_particles *own, const fast_kernel_params *params, fast_kernel_way *way)
{
    double well[LANES];
    for (int l = 0; l < LANES; l++) {
        double gx = way->gradient.x[l], gy = way->gradient.y[l], gz = way->gradient.z[l];
        double value = way->value[l], g2 = gx * gx + gy * gy + gz * gz;
        double farthest = params->farthest * (double)own->size[l];
        double over = 1 / sqrt(g2), back = value * over * over;
        double x = way->to.x[l] - back * gx, y = way->to.y[l] - back * gy, z = way->to.z[l] - back * gz;
        double dx = x - own->position.x[l], dy = y - own->position.y[l], dz = z - own->position.z[l];
        double length2 = dx * dx + dy * dy + dz * dz;
        double near = value * value < farthest * farthest * g2 ? 1.0 : 0.0;
        well[l] = length2 <= way->limit2[l] ? near : 0.0;
        way->length[l] = sqrt(length2);
        way->to.x[l] = x;
        way->to.y[l] = y;
        way->to.z[l] = z;
        way->gradient.x[l] = gx * over;
        way->gradient.y[l] = gy * over;
        way->gradient.z[l] = gz * over;
    }
    for (int l = 0; l < LANES; l++) way->ends_well[l] &= well[l] > 0;
}

/* How many neighbours the particle with the most of them has. */
ISA_INLINE uint32_t most_neighbours(const fast_kernel_particles *own)
{
    uint32_t most = 0;
    for (int l = 0; l < LANES; l++) most = own->count[l] > most ? own->count[l] : most;
    return most;
}

ISA_INLINE float reach_of(const fast_kernel_params *params)
{
    return (float)(M_PI * params->unit / params->support);
}

/* One loop for each kind of pairs: in a loop that asks which it is the rows just stored are loaded under a mask, which waits for
 * the stores. */
#define VERSION(isa, target)                                                                                \
    target static void forces_##isa(const neighbours_place *place, const fast_kernel_particles *particles,  \
                                    const fast_kernel_params *params, fast_kernel_forces *out)              \
    {                                                                                                       \
        const float reach = reach_of(params);                                                               \
        const uint32_t most = most_neighbours(particles);                                                   \
        scales s;                                                                                           \
        fast_kernel_forces sums;                                                                            \
        row b, n;                                                                                           \
        set_up(particles, reach, &s, &sums);                                                                \
        for (uint32_t k = 0; !params->normal && k < most; k++) {                                            \
            load_##isa((source){.place = place}, particles->list, k, LANES, &b);                            \
            add_row(&b, NULL, k, particles, &s, reach, &sums);                                              \
        }                                                                                                   \
        for (uint32_t k = 0; params->normal && k < most; k++) {                                             \
            load_##isa((source){.place = place}, particles->list, k, LANES, &b);                            \
            load_##isa((source){.normal = params->normal}, particles->list, k, LANES, &n);                  \
            add_row(&b, &n, k, particles, &s, reach, &sums);                                                \
        }                                                                                                   \
        *out = sums;                                                                                        \
    }                                                                                                       \
    target static inline __attribute__((always_inline)) void energies_##isa(                                \
        const neighbours_place *place, const fast_kernel_particles *particles,                              \
        const fast_kernel_params *params, size_t lanes, float out[LANES])                                   \
    {                                                                                                       \
        const float reach = reach_of(params);                                                               \
        const uint32_t most = most_neighbours(particles);                                                   \
        scales s;                                                                                           \
        fast_kernel_forces unused;                                                                          \
        float sums[LANES] = {0};                                                                            \
        row b, n;                                                                                           \
        set_up(particles, reach, &s, &unused);                                                              \
        for (uint32_t k = 0; !params->normal && k < most; k++) {                                            \
            load_##isa((source){.place = place}, particles->list, k, lanes, &b);                            \
            add_energy(&b, NULL, k, particles, &s, reach, lanes, sums);                                     \
        }                                                                                                   \
        for (uint32_t k = 0; params->normal && k < most; k++) {                                             \
            load_##isa((source){.place = place}, particles->list, k, lanes, &b);                            \
            load_##isa((source){.normal = params->normal}, particles->list, k, lanes, &n);                  \
            add_energy(&b, &n, k, particles, &s, reach, lanes, sums);                                       \
        }                                                                                                   \
        for (size_t l = 0; l < lanes; l++) out[l] = sums[l];                                                \
    }                                                                                                       \
    target static void energy_##isa(const neighbours_place *place, const fast_kernel_particles *particles,  \
                                    const fast_kernel_params *params, size_t count, float out[LANES])       \
    {                                                                                                       \
        if (count > LANES / 2)                                                                              \
            energies_##isa(place, particles, params, LANES, out);                                           \
        else                                                                                                \
            energies_##isa(place, particles, params, LANES / 2, out);                                       \
    }                                                                                                       \
    target static void step_##isa(const fast_kernel_particles *particles, const fast_kernel_forces *forces, \
                                  const fast_kernel_params *params, fast_kernel_way *out)                   \
    {                                                                                                       \
        step(particles, forces, params, out);                                                               \
    }                                                                                                       \
    target static void land_##isa(const fast_kernel_particles *particles, const fast_kernel_params *params, \
                                  fast_kernel_way *way)                                                     \
    {                                                                                                       \
        land(particles, params, way);                                                                       \
    }                                                                                                       \
    static const fast_kernel version_##isa = {forces_##isa, step_##isa, land_##isa, energy_##isa};
VERSION(portable, )
VERSION(avx2, ISA_TARGET_AVX2)
VERSION(avx512, ISA_TARGET_AVX512)

const fast_kernel *fast_kernel_for(isa which)
{
    static const fast_kernel *const versions[ISA_COUNT] = {&version_portable, &version_avx2, &version_avx512};
    return versions[which];
}
