// SPDX-License-Identifier: Apache-2.0
/* fast_kernel_pairs: the part that fast_kernel.c compiles once for each instruction set. VERSION(name): the
 * name for this set. VERSION_WIDTH: number of particles that are summed at a time. VERSION_ROOT(x),
 * VERSION_LEAST(a, b): functions of vectors of this number of floats. Only fast_kernel.c includes this file,
 * several times; it has no include guard. (Vectors are passed by pointer: the ABI for passing them by value
 * differs with and without AVX. Sums over lanes are not written as loops: GCC 12 drops stores from such
 * loops.) */

typedef float VERSION(floats) __attribute__((vector_size(4 * VERSION_WIDTH)));
typedef int32_t VERSION(ints) __attribute__((vector_size(4 * VERSION_WIDTH)));

/* Per lane: a where `which` is set, otherwise b. */
#define VERSION_CHOOSE(which, a, b) \
    ((VERSION(floats))(((VERSION(ints))(a) & (which)) | ((VERSION(ints))(b) & ~(which))))
#define VERSION_ALL(number) ((VERSION(floats)){0} + (number))

/* One neighbour of each particle: its position and size, or its normal and amplitude. */
typedef struct VERSION(row) {
    VERSION(ints) x, y, z, rest;
} VERSION(row);

/* The particles, and values derived from their sizes. */
typedef struct VERSION(own) {
    VERSION(ints) x, y, z, count;
    VERSION(floats) size, half, stiffness, amplitude;
    VERSION(floats) nx, ny, nz, axis1[3], axis2[3];
} VERSION(own);

typedef struct VERSION(sums) {
    VERSION(floats) energy, d1, d2, h11, h12, h22, nearest2, pairs, turning[3];
} VERSION(sums);

ISA_INLINE void VERSION(load)(const void *from, const uint32_t *const list[], size_t k, VERSION(row) * out);

/* w cot w as a polynomial in q = w^2, w in [0, pi/2]: least squares on Chebyshev nodes, error 5e-8, with
 * rounding 2e-7. Estrin's scheme, which has the shortest chain of dependent operations. */
ISA_INLINE void VERSION(wcotw)(const VERSION(floats) * of, VERSION(floats) * out)
{
    const VERSION(floats) q = *of, q2 = q * q, q4 = q2 * q2;
    const VERSION(floats) low =
        (9.99999958e-01f - 3.33331684e-01f * q) - (2.22326308e-02f + 2.09201489e-03f * q) * q2;
    *out = low - ((2.38374932e-04f + 6.85017157e-06f * q) + 5.74249429e-06f * q2) * q4;
}

/* Loads the particles from `first` on, and computes their frames as vec3_frame does, in single precision. */
ISA_INLINE void VERSION(set_up)(const fast_kernel_particles *from, int first, float reach, VERSION(own) * out)
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
    const VERSION(floats) sign = VERSION_CHOOSE(z < 0, VERSION_ALL(-1), VERSION_ALL(1)), a = -1 / (sign + z),
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
    out->stiffness = (reach * out->half) * (reach * out->half);
}

/* Computes t from two normals, as in pair_weigh; the weight is t t (3 - 2 t). */
ISA_INLINE void VERSION(face)(const VERSION(own) * own, const VERSION(row) * n, VERSION(floats) * out)
{
    const VERSION(floats) cosine =
        own->nx * (VERSION(floats))n->x + own->ny * (VERSION(floats))n->y + own->nz * (VERSION(floats))n->z,
                          t = (cosine - (float)PAIR_FACING_NONE) * (float)(1 / PAIR_FACING_RANGE),
                          below = VERSION_CHOOSE(t < 0, VERSION_ALL(0), t);
    *out = VERSION_LEAST(below, VERSION_ALL(1));
}

/* A pair of each particle with its neighbour. */
typedef struct VERSION(pair) {
    VERSION(floats) dx, dy, dz, r2;
    /* scale2: w^2 = (u pi / 2)^2 per squared distance; share2: factor on the energy, from the sizes */
    VERSION(floats) scale2, share2;
    VERSION(floats) q; /* w^2 */
    /* weight: 1; 0 beyond the support or the end of the list; reduced by the facing weight */
    VERSION(floats) counts;
    VERSION(floats) bend_facing; /* derivative of the weight with respect to the cosine */
    VERSION(floats) amplitude;   /* mean of the two */
    VERSION(row) factors;
} VERSION(pair);

/* Factors of all points, and which of them pairs have. `facing` and `amplitudes` are compile-time
 * constants. */
typedef struct VERSION(factors) {
    const fast_kernel_factors *of;
    bool facing, amplitudes;
} VERSION(factors);

/* Computes the pair of each particle with its neighbour k. */
ISA_INLINE void VERSION(meet)(const neighbours_place *place, VERSION(factors) factors,
                              const uint32_t *const list[], uint32_t k, const VERSION(own) * own, float reach,
                              VERSION(pair) * out)
{
    VERSION(row) b;
    VERSION(load)(place, list, k, &b);
    const VERSION(floats) sizes = own->size + (VERSION(floats))b.rest;
    const VERSION(floats) support = (float)M_PI_2 / reach * sizes, support2 = support * support;
    const VERSION(floats) scale = reach / sizes, share = sizes * own->half;
    out->dx = __builtin_convertvector(own->x - b.x, VERSION(floats));
    out->dy = __builtin_convertvector(own->y - b.y, VERSION(floats));
    out->dz = __builtin_convertvector(own->z - b.z, VERSION(floats));
    /* Entries beyond the end of a list may be the particle itself. They get an infinite distance: powers of
     * w^2 = 0 would be denormal numbers, which are slow. */
    out->r2 = out->dx * out->dx + out->dy * out->dy + out->dz * out->dz +
              (VERSION(floats))((VERSION(ints))VERSION_ALL(INFINITY) & (own->count <= (int32_t)k));
    out->scale2 = scale * scale;
    out->share2 = share * share;
    out->q = VERSION_LEAST(out->r2, support2) * out->scale2 + CLOSEST;
    out->counts = (VERSION(floats))((VERSION(ints))VERSION_ALL(1) & (out->r2 < support2));
    if (factors.facing || factors.amplitudes) VERSION(load)(factors.of, list, k, &out->factors);
    if (factors.amplitudes) out->amplitude = 0.5f * (own->amplitude + (VERSION(floats))out->factors.rest);
    if (factors.facing) {
        VERSION(floats) t;
        VERSION(face)(own, &out->factors, &t);
        out->bend_facing = out->counts * (6 * t * (1 - t) * (float)(1 / PAIR_FACING_RANGE));
        out->counts *= t * t * (3 - 2 * t);
    }
}

/* w cot w, and 1 / w. 1 / w is computed from 1 / q and the root, which do not depend on each other. */
ISA_INLINE void VERSION(turn)(const VERSION(pair) * p, VERSION(floats) * wcot, VERSION(floats) * up,
                              VERSION(floats) * over)
{
    VERSION(wcotw)(&p->q, wcot);
    *up = 1 / p->q;
    *over = VERSION_ROOT(p->q) * *up;
}

ISA_INLINE void VERSION(add_pair)(const VERSION(pair) * p, VERSION(factors) factors, const VERSION(own) * own,
                                  VERSION(sums) * out)
{
    VERSION(floats) wcot, up, over;
    VERSION(turn)(p, &wcot, &up, &over);
    const VERSION(floats) counts = factors.amplitudes ? p->counts * p->amplitude : p->counts;
    const VERSION(floats) weight = counts * own->stiffness, ratio = wcot * up, cot2 = ratio * wcot;
    const VERSION(floats) slope = -(cot2 * over) * weight;                               /* phi' / r */
    const VERSION(floats) bend = (ratio * over) * (1 + cot2) * (2 * p->scale2 * weight); /* phi'' / r^2 */
    const VERSION(floats) potential = (wcot + p->q) * over - (float)M_PI_2;
    const VERSION(floats) a1 = p->dx * own->axis1[0] + p->dy * own->axis1[1] + p->dz * own->axis1[2],
                          a2 = p->dx * own->axis2[0] + p->dy * own->axis2[1] + p->dz * own->axis2[2];
    out->pairs += p->counts;
    out->energy += counts * p->share2 * potential;
    if (factors.facing) {
        const VERSION(floats) bounded = VERSION_LEAST(potential, VERSION_ALL(TURNING_MOST));
        VERSION(floats) pull = p->bend_facing * p->share2 * bounded;
        if (factors.amplitudes) pull *= p->amplitude;
        out->turning[0] += pull * (VERSION(floats))p->factors.x;
        out->turning[1] += pull * (VERSION(floats))p->factors.y;
        out->turning[2] += pull * (VERSION(floats))p->factors.z;
    }
    out->d1 += slope * a1;
    out->d2 += slope * a2;
    const VERSION(floats) bent1 = bend * a1;
    out->h11 += bent1 * a1;
    out->h12 += bent1 * a2;
    out->h22 += bend * a2 * a2;
    const VERSION(floats) seen = VERSION_CHOOSE(p->counts > 0, p->r2, VERSION_ALL(INFINITY));
    out->nearest2 = VERSION_LEAST(seen, out->nearest2);
}

ISA_INLINE void VERSION(add_energy)(const VERSION(pair) * p, VERSION(factors) factors, VERSION(floats) * sum)
{
    VERSION(floats) wcot, up, over;
    VERSION(turn)(p, &wcot, &up, &over);
    const VERSION(floats) counts = factors.amplitudes ? p->counts * p->amplitude : p->counts;
    *sum += counts * p->share2 * ((wcot + p->q) * over - (float)M_PI_2);
}

/* The length of the longest list of the particles from `first` on. */
static inline uint32_t VERSION(longest)(const fast_kernel_particles *own, int first)
{
    uint32_t most = 0;
    for (int l = first; l < first + VERSION_WIDTH; l++) most = own->count[l] > most ? own->count[l] : most;
    return most;
}

/* Sums all pairs of some particles. The next neighbours are loaded before the current ones are summed, to
 * hide the latency. */
ISA_INLINE void VERSION(sum_pairs)(const neighbours_place *place, VERSION(factors) factors,
                                   const uint32_t *const list[], uint32_t most, const VERSION(own) * own,
                                   float reach, VERSION(sums) * out)
{
    VERSION(pair) pair, next;
    if (most > 0) VERSION(meet)(place, factors, list, 0, own, reach, &next);
    for (uint32_t k = 1; k <= most; k++) {
        pair = next;
        VERSION(meet)(place, factors, list, k < most ? k : 0, own, reach, &next);
        VERSION(add_pair)(&pair, factors, own, out);
    }
}

/* Sums the energies of all pairs of some particles. */
ISA_INLINE void VERSION(sum_energies)(const neighbours_place *place, VERSION(factors) factors,
                                      const uint32_t *const list[], uint32_t most, const VERSION(own) * own,
                                      float reach, VERSION(floats) * sum)
{
    VERSION(pair) pair;
    for (uint32_t k = 0; k < most; k++) {
        VERSION(meet)(place, factors, list, k, own, reach, &pair);
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
    const float reach = reach_of(params);
    for (int first = 0; first < LANES; first += VERSION_WIDTH) {
        const uint32_t *const *list = particles->list + first;
        const uint32_t most = VERSION(longest)(particles, first);
        VERSION(own) own;
        VERSION(sums) sums;
        /* set separately: the compiler clears the whole struct with a slow string instruction */
        sums.energy = sums.pairs = sums.d1 = sums.d2 = sums.h11 = sums.h12 = sums.h22 = VERSION_ALL(0);
        sums.turning[0] = sums.turning[1] = sums.turning[2] = VERSION_ALL(0);
        sums.nearest2 = VERSION_ALL(INFINITY);
        VERSION(set_up)(particles, first, reach, &own);
        VERSION_WITH_FACTORS(sum_pairs, list, most, &own, reach, &sums);
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
    const float reach = reach_of(params);
    for (int first = 0; first < (int)count; first += VERSION_WIDTH) {
        const uint32_t *const *list = particles->list + first;
        const uint32_t most = VERSION(longest)(particles, first);
        VERSION(own) own;
        VERSION(floats) sum = VERSION_ALL(0);
        VERSION(set_up)(particles, first, reach, &own);
        VERSION_WITH_FACTORS(sum_energies, list, most, &own, reach, &sum);
        memcpy(out + first, &sum, sizeof sum);
    }
}

static void VERSION(step)(const fast_kernel_particles *particles, const fast_kernel_forces *forces,
                          const fast_kernel_params *params, fast_kernel_way *out)
{
    step(particles, forces, params, out);
}

static void VERSION(land)(const fast_kernel_particles *particles, const fast_kernel_params *params,
                          fast_kernel_way *way)
{
    land(particles, params, way);
}

static const fast_kernel VERSION(version) = {VERSION(forces), VERSION(step), VERSION(land), VERSION(energy)};

#undef VERSION_CHOOSE
#undef VERSION_ALL
#undef VERSION_WITH_FACTORS
