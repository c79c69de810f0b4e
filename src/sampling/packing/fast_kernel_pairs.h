// SPDX-License-Identifier: Apache-2.0
/* fast_kernel_pairs: sums over the neighbours of VERSION_WIDTH particles at a time, one particle per SIMD
 * lane. fast_kernel.c includes this file once for each instruction set (no include guard) and defines before:
 * - VERSION(name): the name of a function or type for the instruction set.
 * - VERSION_WIDTH: the number of floats of a vector.
 * - VERSION_SQRT(x), VERSION_MIN(a, b): functions of such vectors. Vectors are passed by pointer, because the
 *   ABI for passing them by value differs with and without AVX. Sums are written as vector operations and not
 *   as loops over lanes: GCC 12 drops stores from such loops. */

typedef float VERSION(floats) __attribute__((vector_size(4 * VERSION_WIDTH)));
typedef int32_t VERSION(ints) __attribute__((vector_size(4 * VERSION_WIDTH)));

/* Per lane: a where all bits of `which` are set, b where none is. */
#define VERSION_SELECT(which, a, b) \
    ((VERSION(floats))(((VERSION(ints))(a) & (which)) | ((VERSION(ints))(b) & ~(which))))
#define VERSION_ALL(number) ((VERSION(floats)){0} + (number))

/* One neighbour of each particle: the bits of a neighbours_place (position and size) or of a
 * fast_kernel_factors (normal and amplitude). */
typedef struct VERSION(entries) {
    VERSION(ints) x, y, z, rest;
} VERSION(entries);

/* The particles. */
typedef struct VERSION(own) {
    VERSION(ints) x, y, z, count;
    VERSION(floats) size, amplitude;
    VERSION(floats) half;      /* 1 / (2 size) */
    VERSION(floats) stiffness; /* size2 times scale2 of a pair (below), which is equal for all its pairs */
    VERSION(floats) nx, ny, nz, axis1[3], axis2[3];
} VERSION(own);

typedef struct VERSION(sums) {
    VERSION(floats) energy, d1, d2, h11, h12, h22, nearest2, pairs, turning[3];
} VERSION(sums);

/* Loads entry list[l][k] of `from` for each lane l. */
ISA_INLINE void VERSION(load)(const void *from, const uint32_t *const list[], size_t k,
                              VERSION(entries) * out);

ISA_INLINE void VERSION(w_cot_w)(const VERSION(floats) * squared, VERSION(floats) * out)
{
    const VERSION(floats) q = *squared, q2 = q * q, q4 = q2 * q2;
    *out = PAIR_W_COT_W(q, q2, q4);
}

/* Loads the particles from `first` on, and computes their frames as vec3_frame does, in single precision. */
ISA_INLINE void VERSION(set_up)(const fast_kernel_particles *from, int first, float angle, VERSION(own) * out)
{
    VERSION(floats) x, y, z;
    memcpy(&out->x, from->x + first, sizeof out->x);
    memcpy(&out->y, from->y + first, sizeof out->y);
    memcpy(&out->z, from->z + first, sizeof out->z);
    memcpy(&out->count, from->count + first, sizeof out->count);
    memcpy(&out->size, from->size + first, sizeof out->size);
    memcpy(&out->amplitude, from->amplitude + first, sizeof out->amplitude);
    for (int l = 0; l < VERSION_WIDTH; l++) {
        x[l] = (float)from->normal.x[first + l];
        y[l] = (float)from->normal.y[first + l];
        z[l] = (float)from->normal.z[first + l];
    }
    const VERSION(floats) sign = VERSION_SELECT(z < 0, VERSION_ALL(-1), VERSION_ALL(1)), a = -1 / (sign + z),
                          b = x * y * a;
    out->nx = x;
    out->ny = y;
    out->nz = z;
    out->axis1[0] = 1 + sign * x * x * a;
    out->axis1[1] = sign * b;
    out->axis1[2] = -sign * x;
    out->axis2[0] = b;
    out->axis2[1] = sign + y * y * a;
    out->axis2[2] = -y;
    out->half = 0.5f / out->size;
    out->stiffness = (angle * out->half) * (angle * out->half);
}

/* The facing weight of a pair is t t (3 - 2 t) (pair_weigh). Computes t from the normals of the two. */
ISA_INLINE void VERSION(facing_argument)(const VERSION(own) * own, const VERSION(entries) * n,
                                         VERSION(floats) * out)
{
    const VERSION(floats) cosine =
        own->nx * (VERSION(floats))n->x + own->ny * (VERSION(floats))n->y + own->nz * (VERSION(floats))n->z,
                          t = (cosine - (float)PAIR_FACING_NONE) * (float)(1 / PAIR_FACING_RANGE),
                          below = VERSION_SELECT(t < 0, VERSION_ALL(0), t);
    *out = VERSION_MIN(below, VERSION_ALL(1));
}

/* One pair of each particle: with neighbour k of its list. */
typedef struct VERSION(pair) {
    VERSION(floats) dx, dy, dz, r2; /* from the neighbour to the particle; squared distance */
    VERSION(floats) q;              /* w^2, at most (pi/2)^2 */
    VERSION(floats) scale2;         /* w^2 over r^2 */
    VERSION(floats) size2;  /* squared mean size of the two over that of the particle: factor of the energy */
    VERSION(floats) weight; /* the facing weight, or 1; 0 beyond the support or the end of the list */
    VERSION(floats) weight_slope; /* derivative of the weight by the cosine of the two normals */
    VERSION(floats) amplitude;    /* mean of the two */
    VERSION(entries) factors;
} VERSION(pair);

/* The factors of all points, and which of them pairs have. `facing` and `amplitudes` are constants at compile
 * time (VERSION_WITH_FACTORS). */
typedef struct VERSION(factors) {
    const fast_kernel_factors *of;
    bool facing, amplitudes;
} VERSION(factors);

/* Loads neighbour k of each particle and computes what forces and energies have in common. */
ISA_INLINE void VERSION(load_pair)(const neighbours_place *place, VERSION(factors) factors,
                                   const uint32_t *const list[], uint32_t k, const VERSION(own) * own,
                                   float angle, VERSION(pair) * out)
{
    VERSION(entries) other;
    VERSION(load)(place, list, k, &other);
    const VERSION(floats) sizes = own->size + (VERSION(floats))other.rest;
    const VERSION(floats) support = (float)M_PI_2 / angle * sizes, support2 = support * support;
    const VERSION(floats) scale = angle / sizes, size = sizes * own->half;
    out->dx = __builtin_convertvector(own->x - other.x, VERSION(floats));
    out->dy = __builtin_convertvector(own->y - other.y, VERSION(floats));
    out->dz = __builtin_convertvector(own->z - other.z, VERSION(floats));
    /* Entries beyond the end of a list may be the particle itself. They get an infinite distance: powers of
     * w^2 = 0 would be denormal numbers, which are slow. */
    out->r2 = out->dx * out->dx + out->dy * out->dy + out->dz * out->dz +
              (VERSION(floats))((VERSION(ints))VERSION_ALL(INFINITY) & (own->count <= (int32_t)k));
    out->scale2 = scale * scale;
    out->size2 = size * size;
    out->q = VERSION_MIN(out->r2, support2) * out->scale2 + CLOSEST;
    out->weight = (VERSION(floats))((VERSION(ints))VERSION_ALL(1) & (out->r2 < support2));
    if (factors.facing || factors.amplitudes) VERSION(load)(factors.of, list, k, &out->factors);
    if (factors.amplitudes) out->amplitude = 0.5f * (own->amplitude + (VERSION(floats))out->factors.rest);
    if (factors.facing) {
        VERSION(floats) t;
        VERSION(facing_argument)(own, &out->factors, &t);
        out->weight_slope = out->weight * (6 * t * (1 - t) * (float)(1 / PAIR_FACING_RANGE));
        out->weight *= t * t * (3 - 2 * t);
    }
}

/* w cot w, 1 / w^2 and 1 / w. The division and the root do not depend on each other. */
ISA_INLINE void VERSION(terms)(const VERSION(pair) * p, VERSION(floats) * w_cot, VERSION(floats) * over_q,
                               VERSION(floats) * over_w)
{
    VERSION(w_cot_w)(&p->q, w_cot);
    *over_q = 1 / p->q;
    *over_w = VERSION_SQRT(p->q) * *over_q;
}

ISA_INLINE void VERSION(add_pair)(const VERSION(pair) * p, VERSION(factors) factors, const VERSION(own) * own,
                                  VERSION(sums) * out)
{
    VERSION(floats) w_cot, over_q, over_w;
    VERSION(terms)(p, &w_cot, &over_q, &over_w);
    const VERSION(floats) weight = factors.amplitudes ? p->weight * p->amplitude : p->weight;
    const VERSION(floats) stiffness = weight * own->stiffness, ratio = w_cot * over_q, cot2 = ratio * w_cot;
    /* phi(w) = cot w + w - pi/2, phi'(w) = -cot^2 w, phi''(w) = 2 cot w (1 + cot^2 w) */
    const VERSION(floats) potential = (w_cot + p->q) * over_w - (float)M_PI_2;
    const VERSION(floats) slope = -(cot2 * over_w) * stiffness; /* phi' / r */
    const VERSION(floats) bend =
        (ratio * over_w) * (1 + cot2) * (2 * p->scale2 * stiffness); /* phi'' / r^2 */
    const VERSION(floats) a1 = p->dx * own->axis1[0] + p->dy * own->axis1[1] + p->dz * own->axis1[2],
                          a2 = p->dx * own->axis2[0] + p->dy * own->axis2[1] + p->dz * own->axis2[2];
    out->pairs += p->weight;
    out->energy += weight * p->size2 * potential;
    if (factors.facing) {
        const VERSION(floats) bounded = VERSION_MIN(potential, VERSION_ALL(TURNING_MOST));
        VERSION(floats) pull = p->weight_slope * p->size2 * bounded;
        if (factors.amplitudes) pull *= p->amplitude;
        out->turning[0] += pull * (VERSION(floats))p->factors.x;
        out->turning[1] += pull * (VERSION(floats))p->factors.y;
        out->turning[2] += pull * (VERSION(floats))p->factors.z;
    }
    out->d1 += slope * a1;
    out->d2 += slope * a2;
    const VERSION(floats) bend1 = bend * a1;
    out->h11 += bend1 * a1;
    out->h12 += bend1 * a2;
    out->h22 += bend * a2 * a2;
    const VERSION(floats) distance2 = VERSION_SELECT(p->weight > 0, p->r2, VERSION_ALL(INFINITY));
    out->nearest2 = VERSION_MIN(distance2, out->nearest2);
}

ISA_INLINE void VERSION(add_energy)(const VERSION(pair) * p, VERSION(factors) factors, VERSION(floats) * sum)
{
    VERSION(floats) w_cot, over_q, over_w;
    VERSION(terms)(p, &w_cot, &over_q, &over_w);
    const VERSION(floats) weight = factors.amplitudes ? p->weight * p->amplitude : p->weight;
    *sum += weight * p->size2 * ((w_cot + p->q) * over_w - (float)M_PI_2);
}

/* The length of the longest list of the particles from `first` on. */
static inline uint32_t VERSION(longest)(const fast_kernel_particles *own, int first)
{
    uint32_t longest = 0;
    for (int l = first; l < first + VERSION_WIDTH; l++)
        longest = own->count[l] > longest ? own->count[l] : longest;
    return longest;
}

/* Sums the pairs with the first `count` entries of the lists. The next entries are loaded before the current
 * ones are summed, to hide the latency. */
ISA_INLINE void VERSION(sum_pairs)(const neighbours_place *place, VERSION(factors) factors,
                                   const uint32_t *const list[], uint32_t count, const VERSION(own) * own,
                                   float angle, VERSION(sums) * out)
{
    VERSION(pair) pair, next;
    if (count > 0) VERSION(load_pair)(place, factors, list, 0, own, angle, &next);
    for (uint32_t k = 1; k <= count; k++) {
        pair = next;
        VERSION(load_pair)(place, factors, list, k < count ? k : 0, own, angle, &next);
        VERSION(add_pair)(&pair, factors, own, out);
    }
}

/* The same for energies only. */
ISA_INLINE void VERSION(sum_energies)(const neighbours_place *place, VERSION(factors) factors,
                                      const uint32_t *const list[], uint32_t count, const VERSION(own) * own,
                                      float angle, VERSION(floats) * sum)
{
    VERSION(pair) pair;
    for (uint32_t k = 0; k < count; k++) {
        VERSION(load_pair)(place, factors, list, k, own, angle, &pair);
        VERSION(add_energy)(&pair, factors, sum);
    }
}

/* Calls a function once for each choice of the factors, which are then constants. */
#define VERSION_WITH_FACTORS(function, ...)                                                \
    do {                                                                                   \
        const fast_kernel_factors *of = params->factors;                                   \
        if (params->has_facing && params->has_amplitudes)                                  \
            VERSION(function)(place, (VERSION(factors)){of, true, true}, __VA_ARGS__);     \
        else if (params->has_facing)                                                       \
            VERSION(function)(place, (VERSION(factors)){of, true, false}, __VA_ARGS__);    \
        else if (params->has_amplitudes)                                                   \
            VERSION(function)(place, (VERSION(factors)){of, false, true}, __VA_ARGS__);    \
        else                                                                               \
            VERSION(function)(place, (VERSION(factors)){NULL, false, false}, __VA_ARGS__); \
    } while (0)

static void VERSION(forces)(const neighbours_place *place, const fast_kernel_particles *particles,
                            const fast_kernel_params *params, fast_kernel_forces *out)
{
    const float angle = angle_of_unit(params);
    for (int first = 0; first < LANES; first += VERSION_WIDTH) {
        const uint32_t *const *list = particles->list + first;
        const uint32_t longest = VERSION(longest)(particles, first);
        VERSION(own) own;
        VERSION(sums) sums;
        /* set separately: the compiler clears the whole struct with a slow string instruction */
        sums.energy = sums.pairs = sums.d1 = sums.d2 = sums.h11 = sums.h12 = sums.h22 = VERSION_ALL(0);
        sums.turning[0] = sums.turning[1] = sums.turning[2] = VERSION_ALL(0);
        sums.nearest2 = VERSION_ALL(INFINITY);
        VERSION(set_up)(particles, first, angle, &own);
        VERSION_WITH_FACTORS(sum_pairs, list, longest, &own, angle, &sums);
#define VERSION_KEEP(to, from) memcpy((to) + first, &(from), sizeof(from))
        VERSION_KEEP(out->energy, sums.energy);
        VERSION_KEEP(out->d1, sums.d1);
        VERSION_KEEP(out->d2, sums.d2);
        VERSION_KEEP(out->h11, sums.h11);
        VERSION_KEEP(out->h12, sums.h12);
        VERSION_KEEP(out->h22, sums.h22);
        VERSION_KEEP(out->nearest2, sums.nearest2);
        VERSION_KEEP(out->pairs, sums.pairs);
        for (int a = 0; a < 3; a++) {
            VERSION_KEEP(out->turning[a], sums.turning[a]);
            VERSION_KEEP(out->axis1[a], own.axis1[a]);
            VERSION_KEEP(out->axis2[a], own.axis2[a]);
        }
#undef VERSION_KEEP
    }
}

static void VERSION(energy)(const neighbours_place *place, const fast_kernel_particles *particles,
                            const fast_kernel_params *params, size_t count, float out[LANES])
{
    const float angle = angle_of_unit(params);
    for (int first = 0; first < (int)count; first += VERSION_WIDTH) {
        const uint32_t *const *list = particles->list + first;
        const uint32_t longest = VERSION(longest)(particles, first);
        VERSION(own) own;
        VERSION(floats) sum = VERSION_ALL(0);
        VERSION(set_up)(particles, first, angle, &own);
        VERSION_WITH_FACTORS(sum_energies, list, longest, &own, angle, &sum);
        memcpy(out + first, &sum, sizeof sum);
    }
}

static void VERSION(tangent_step)(const fast_kernel_particles *particles, const fast_kernel_forces *forces,
                                  const fast_kernel_params *params, fast_kernel_step *out)
{
    tangent_step(particles, forces, params, out);
}

static void VERSION(project)(const fast_kernel_particles *particles, const fast_kernel_params *params,
                             fast_kernel_step *step)
{
    project(particles, params, step);
}

static const fast_kernel VERSION(version) = {VERSION(forces), VERSION(tangent_step), VERSION(project),
                                             VERSION(energy)};

#undef VERSION_SELECT
#undef VERSION_ALL
#undef VERSION_WITH_FACTORS
