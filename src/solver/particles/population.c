#include "solver/particles/population.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "field/projection.h"

/* A particle whose energy is one standard deviation off the mean is this much likelier, on the logarithm; and
 * no more than this many deviations count. A choice by rank alone would take whole clusters at once, and
 * leave holes. */
static const double BIAS = 1, BIAS_DEVIATIONS = 3;
/* A twin is put on the surface to this fraction of the offset; the relaxation does the rest. */
static const double SPLIT_ACCEPT = 1e-3;
static const int SPLIT_STEPS = 10, SPLIT_DIRECTIONS = 8;
/* A twin that the projection carries farther than this, of the offset, is on another sheet. */
static const double SPLIT_FARTHEST = 2;

typedef struct lot {
    double key; /* the smallest win */
    uint32_t particle;
} lot;

static int compare_lot(const void *a, const void *b)
{
    const lot *x = a, *y = b;
    if (x->key != y->key) return x->key < y->key ? -1 : 1;
    return x->particle < y->particle ? -1 : 1;
}

static int compare_index(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return x < y ? -1 : x > y;
}

/* How crowded it is around a particle: its energy, freed of its amplitude. */
static double crowding(const particles *p, size_t i)
{
    return (double)p->energy[i] / particles_amplitude(p, i);
}

/* Draws without replacement, in proportion to weights: the least of -log(u) / weight win (Efraimidis and
 * Spirakis 2006). */
bool population_choose(const particles *p, size_t k, population_bias bias, rng *r, uint32_t *chosen, error *e)
{
    size_t n = p->count;
    assert(k <= n);
    lot *lots = mem_array(n, sizeof *lots, "the choice of particles", e);
    if (!lots) return false;
    double mean = 0, squares = 0;
    for (size_t i = 0; i < n; i++) mean += crowding(p, i) / (double)n;
    for (size_t i = 0; i < n; i++) squares += (crowding(p, i) - mean) * (crowding(p, i) - mean) / (double)n;
    double deviation = sqrt(squares), sign = bias == POPULATION_LOW_ENERGY ? -1 : 1;
    for (size_t i = 0; i < n; i++) {
        double z = 0;
        if (particles_is_fixed(p, i)) { /* who is held on a curve is not chosen */
            lots[i] = (lot){INFINITY, (uint32_t)i};
            continue;
        }
        if (bias != POPULATION_RANDOM && deviation > 0)
            z = fmin(fmax(sign * (crowding(p, i) - mean) / deviation, -BIAS_DEVIATIONS), BIAS_DEVIATIONS);
        lots[i] = (lot){-log1p(-rng_uniform(r)) * exp(-BIAS * z), (uint32_t)i};
    }
    qsort(lots, n, sizeof *lots, compare_lot);
    for (size_t i = 0; i < k; i++) chosen[i] = lots[i].particle;
    qsort(chosen, k, sizeof *chosen, compare_index);
    free(lots);
    return true;
}

bool population_split(const field *all, particles *p, size_t i, double offset, rng *r)
{
    const field *f = particles_field(p, all, i);
    const projection_limits limits = {SPLIT_STEPS, SPLIT_ACCEPT * offset, SPLIT_ACCEPT * offset,
                                      SPLIT_ACCEPT * offset};
    vec3 axis1, axis2, x = p->position[i];
    vec3_frame(p->normal[i], &axis1, &axis2);
    for (int k = 0; k < SPLIT_DIRECTIONS; k++) {
        double turn = 2 * M_PI * rng_uniform(r);
        vec3 step = vec3_axpy(offset * cos(turn), axis1, vec3_scale(axis2, offset * sin(turn)));
        vec3 a = vec3_add(x, step), b = vec3_sub(x, step), normal_a, normal_b;
        if (!projection_find(f, &limits, &a, &normal_a) || !projection_find(f, &limits, &b, &normal_b) ||
            vec3_norm(vec3_sub(a, x)) > SPLIT_FARTHEST * offset ||
            vec3_norm(vec3_sub(b, x)) > SPLIT_FARTHEST * offset ||
            (p->patch && (!field_is_within(f, a) || !field_is_within(f, b))))
            continue;
        particles_copy(p, p->count, i);
        p->position[i] = a;
        p->normal[i] = normal_a;
        p->position[p->count] = b;
        p->normal[p->count++] = normal_b;
        return true;
    }
    return false;
}

size_t population_remove(particles *p, const bool *marked)
{
    size_t kept = 0, count = p->count;
    for (size_t i = 0; i < count; i++)
        if (!marked[i]) particles_copy(p, kept++, i);
    p->count = kept;
    return count - kept;
}
