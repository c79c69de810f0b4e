// SPDX-License-Identifier: Apache-2.0
/* population: insertion and deletion of particles for the global control of section 6.1 and for the fission
 * and death of Witkin and Heckbert. Deterministic: the result depends only on the particles and the caller's
 * generator. Single-threaded.
 */
#ifndef HEXAD_SAMPLING_SOLVER_PARTICLES_POPULATION_H
#define HEXAD_SAMPLING_SOLVER_PARTICLES_POPULATION_H

#include "base/core/error.h"
#include "base/core/rng.h"
#include "surface/field/field.h"
#include "sampling/solver/particles/particles.h"

typedef enum population_bias {
    POPULATION_RANDOM,
    POPULATION_HIGH_ENERGY, /* particles of high energy are more likely */
    POPULATION_LOW_ENERGY   /* particles of low energy are more likely */
} population_bias;

/* Chooses `k` distinct free particles (k at most their number), at random or weighted by energy over
 * amplitude. chosen[k]: their indices, ascending. Error: limit_memory. */
bool population_choose(const particles *p, size_t k, population_bias bias, rng *r, uint32_t *chosen,
                       error *e);

/* Splits particle i in its tangent plane. The particle and its twin are placed about `offset` (world units)
 * from its position in opposite directions, on the surface. The twin becomes the last particle; the capacity
 * suffices. False: no valid position was found, and nothing changed. */
bool population_split(const field *all, particles *p, size_t i, double offset, rng *r);

/* Removes the marked particles and keeps the order of the others. Returns the number of removed particles. */
size_t population_remove(particles *p, const bool *marked);

#endif
