// SPDX-License-Identifier: Apache-2.0
/* adaptation: the global control of section 6.1: the support (support.c), and the count of a bounded
 * support (count.c). */
#ifndef HEXAD_SAMPLING_SOLVER_ADAPTATION_H
#define HEXAD_SAMPLING_SOLVER_ADAPTATION_H

#include "sampling/solver/solver_state.h"

/* One Newton step on log E as a function of log sigma: an estimate of the support with the ideal energy.
 * `energy` > 0: mean energy over mean amplitude for the support `sigma`. World units. */
double solver_nearer_support(const solver *s, double sigma, double energy);

/* Sets s->state.sigma to the support for which the particles, at their present positions, have the ideal
 * energy; at most 3 spacings. If that is below half a spacing, sigma is unchanged. The neighbour lists are
 * rebuilt. Error: limit_memory. */
bool solver_find_support(solver *s, error *e);

/* Clamps sigma to params.max_sigma, if that is > 0, and makes lists for it. `changed`: the number of
 * particles was changed since the last lists. Error: limit_memory. */
bool solver_apply_support(solver *s, bool changed, error *e);

/* Inserts or deletes particles once, towards the count for which the ideal support is params.max_sigma. On
 * entry sigma is the ideal support of the present particles; on return it is scaled to the new count. At
 * most doubles the count. *changed: the count was changed. Error: limit_memory. */
bool solver_adapt_count(solver *s, bool *changed, error *e);

#endif
