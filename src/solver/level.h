/* level: where the particles of a level start. */
#ifndef HEXAD_SOLVER_LEVEL_H
#define HEXAD_SOLVER_LEVEL_H

#include "solver/solver_state.h"

/* Puts particles on the coarsest level, and drops it if its particles do not resolve the surface. `support` is over the spacing.
 * Errors: limit_memory, no_surface. */
bool solver_place(solver *s, double support, error *e);

/* What a round of the coarsest level shows: after the first whether the level resolves the surface, after a later one how many
 * particles its refinement will give. *again: the coarsest level was placed anew with a better count. Errors: limit_memory,
 * no_surface. */
bool solver_replan(solver *s, bool *again, error *e);

/* The next level: its particles; then, after passes that may relocate some of them, their order in memory and lists. Errors:
 * limit_memory, no_surface. */
bool solver_refine(solver *s, error *e);
bool solver_enter_refined(solver *s, error *e);

#endif
