/* start: initial positions of particles on a surface. */
#ifndef HEXAD_SOLVER_START_H
#define HEXAD_SOLVER_START_H

#include "solver/level_plan.h"
#include "solver/particles/particles.h"
#include "solver/solver_params.h"

/* Places p->count particles, with normals, on the parts of the surface that get their first particles on a level. The first particles are
 * samples of the boundaries of an open surface, or of the curves of patches. A particle whose projection fails, or ends at a degenerate
 * zero of the field, is drawn again; *removed counts these draws. `spacing`: h, world units. Deterministic in params->seed. Errors:
 * no_surface (too few draws reach the surface), limit_memory, cancelled. */
bool start_place(const field *f, const surface *scan, const solver_params *params, const level_plan *plan,
                 int level, double spacing, threads *pool, particles *p, size_t *removed, error *e);

#endif
