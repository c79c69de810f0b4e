/* population: particles that split and particles that go, for the global control of section 6.1 and for the
 * fission and death of Witkin and Heckbert. Deterministic: everything follows from the particles and the
 * generator that the caller hands in. One thread.
 */
#ifndef HEXAD_SOLVER_POPULATION_H
#define HEXAD_SOLVER_POPULATION_H

#include "base/error.h"
#include "base/rng.h"
#include "field/field.h"
#include "solver/particles/particles.h"

typedef enum population_bias {
    POPULATION_RANDOM,
    POPULATION_HIGH_ENERGY, /* those with much energy are the likelier */
    POPULATION_LOW_ENERGY
} population_bias;

/* Chooses `k` different particles, no more than there are free ones, by energy over amplitude or at random: `chosen` receives their indices,
 * ascending. Error: limit_memory. */
bool population_choose(const particles *p, size_t k, population_bias bias, rng *r, uint32_t *chosen,
                       error *e);

/* Splits particle i in its tangent plane: it and its twin, which becomes the last particle, end about
 * `offset` from where it was, on either side of it and on the surface. `p` has room for one more. False,
 * nothing changed: no place was found. */
bool population_split(const field *all, particles *p, size_t i, double offset, rng *r);

/* Takes the marked particles away; the others keep their order. Returns how many went. */
size_t population_remove(particles *p, const bool *marked);

#endif
