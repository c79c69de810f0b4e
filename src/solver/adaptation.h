/* adaptation: the global control of section 6.1: the support (support.c), and the count of a bounded support (count.c). */
#ifndef HEXAD_SOLVER_ADAPTATION_H
#define HEXAD_SOLVER_ADAPTATION_H

#include "solver/solver_state.h"

/* One step of Newton's method on log E against log sigma, from a support and the energy under it. */
double solver_nearer_support(const solver *s, double sigma, double energy);

/* Sets sigma to the support under which the particles, at their present positions, have the ideal energy. If there is none, sigma is
 * unchanged. Error: limit_memory. */
bool solver_find_support(solver *s, error *e);

/* Bounds sigma by params.max_sigma and builds lists for it. `changed`: the count was. Error: limit_memory. */
bool solver_apply_support(solver *s, bool changed, error *e);

/* Inserts or deletes particles until sigma, the ideal support of the present particles, is within params.max_sigma. Error:
 * limit_memory. */
bool solver_adapt_count(solver *s, bool *changed, error *e);

#endif
