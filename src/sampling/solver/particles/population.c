// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/particles/population.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>

#include "base/core/compare.h"
#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "surface/field/projection.h"

/* Logarithm of the weight of a particle per standard deviation of its energy from the mean. A choice by rank
 * would take whole clusters and leave gaps. */
static const double BIAS = 1;
/* Energies are clamped to this many standard deviations. */
static const double MAX_DEVIATIONS = 3;
/* Maximum number of random directions that a split tries. */
static const int SPLIT_DIRECTIONS = 8;
/* Maximum distance of a projected twin over the offset. Farther: the twin is on another part of the
 * surface. */
static const double SPLIT_MAX_DISTANCE = 2;

typedef struct draw {
    double key; /* the particles of the smallest keys are chosen */
    uint32_t particle;
} draw;

static int compare_draws(const void *a, const void *b)
{
    const draw *x = a, *y = b;
    if (x->key != y->key) return x->key < y->key ? -1 : 1;
    return x->particle < y->particle ? -1 : 1;
}

/* Energy over amplitude: the local density measure of a particle. */
static double density(const particles *p, size_t i)
{
    return (double)p->energy[i] / particles_amplitude(p, i);
}

/* Weighted sampling without replacement: the smallest keys -log(u) / weight are chosen (Efraimidis and
 * Spirakis 2006). */
bool population_choose(const particles *p, size_t k, population_bias bias, rng *r, uint32_t *chosen, error *e)
{
    size_t n = p->count;
    assert(k <= n);
    draw *draws = mem_array(n, sizeof *draws, "the choice of particles", e);
    if (!draws) return false;
    double mean = 0, squares = 0;
    for (size_t i = 0; i < n; i++) mean += density(p, i) / (double)n;
    for (size_t i = 0; i < n; i++) squares += (density(p, i) - mean) * (density(p, i) - mean) / (double)n;
    double deviation = sqrt(squares), sign = bias == POPULATION_LOW_ENERGY ? -1 : 1;
    for (size_t i = 0; i < n; i++) {
        double z = 0;
        if (particles_is_fixed(p, i)) {
            draws[i] = (draw){INFINITY, (uint32_t)i};
            continue;
        }
        if (bias != POPULATION_RANDOM && deviation > 0)
            z = fmin(fmax(sign * (density(p, i) - mean) / deviation, -MAX_DEVIATIONS), MAX_DEVIATIONS);
        draws[i] = (draw){-elementary_log1p(-rng_uniform(r)) * elementary_exp(-BIAS * z), (uint32_t)i};
    }
    qsort(draws, n, sizeof *draws, compare_draws);
    for (size_t i = 0; i < k; i++) chosen[i] = draws[i].particle;
    qsort(chosen, k, sizeof *chosen, compare_uint32);
    free(draws);
    return true;
}

bool population_split(const field *all, particles *p, size_t i, double offset, rng *r)
{
    const field *f = particles_field(p, all, i);
    const projection_limits limits = projection_draft(offset);
    vec3 axis1, axis2, x = p->position[i];
    vec3_frame(p->normal[i], &axis1, &axis2);
    for (int k = 0; k < SPLIT_DIRECTIONS; k++) {
        double turn = 2 * M_PI * rng_uniform(r);
        vec3 step =
            vec3_axpy(offset * elementary_cos(turn), axis1, vec3_scale(axis2, offset * elementary_sin(turn)));
        vec3 a = vec3_add(x, step), b = vec3_sub(x, step), normal_a, normal_b;
        if (!projection_find(f, &limits, &a, &normal_a) || !projection_find(f, &limits, &b, &normal_b) ||
            vec3_norm(vec3_sub(a, x)) > SPLIT_MAX_DISTANCE * offset ||
            vec3_norm(vec3_sub(b, x)) > SPLIT_MAX_DISTANCE * offset ||
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
