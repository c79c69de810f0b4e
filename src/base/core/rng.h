// SPDX-License-Identifier: Apache-2.0
/* rng: seeded random numbers, the same on every machine (xoshiro256++ of Blackman and Vigna,
 * seeded through splitmix64). A generator belongs to one thread at a time. */
#ifndef HEXAD_BASE_CORE_RNG_H
#define HEXAD_BASE_CORE_RNG_H

#include <stdint.h>

typedef struct rng {
    uint64_t state[4];
} rng;

/* `stream` selects independent generators for one seed. */
rng rng_seed(uint64_t seed, uint64_t stream);
uint64_t rng_next(rng *r);
double rng_uniform(rng *r); /* uniform in [0, 1), 53 bits */

#endif
