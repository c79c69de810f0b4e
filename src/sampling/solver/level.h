// SPDX-License-Identifier: Apache-2.0
/* level: initial positions of the particles of a level, and the step to the next level. Private to the
 * solver; the functions change s->state. */
#ifndef HEXAD_SAMPLING_SOLVER_LEVEL_H
#define HEXAD_SAMPLING_SOLVER_LEVEL_H

#include "sampling/solver/solver_state.h"

/* Places the particles of the coarsest level and builds their lists. If they do not resolve the surface, the
 * level is dropped and the next one becomes the coarsest. `support`: initial support over the spacing.
 * Errors: limit_memory, no_surface, cancelled. */
bool solver_place(solver *s, double support, error *e);

/* Corrects the level plan after a round of the coarsest level. After the first stage: drops the level if its
 * particles do not resolve the surface. After a later stage: corrects the counts of the levels by the number
 * of edges that refinement will use. *again: the coarsest level was placed again, with another count or as
 * the next finer level. Errors: limit_memory, no_surface, cancelled. */
bool solver_replan(solver *s, bool *again, error *e);

/* solver_refine makes the particles of the next level. The caller may then relocate some of them.
 * solver_enter_refined sorts them in memory and builds their lists. Errors: limit_memory, no_surface,
 * cancelled. */
bool solver_refine(solver *s, error *e);
bool solver_enter_refined(solver *s, error *e);

#endif
