/* start: the first positions of particles on a surface. */
#ifndef HEXAD_SOLVER_START_H
#define HEXAD_SOLVER_START_H

#include "solver/level_plan.h"
#include "solver/particles/particles.h"
#include "solver/solver_params.h"

/* Places p->count particles on the parts of the surface that get their first ones on a level, with normals; the first of them in rows along the boundaries of an open
 * surface, unless the start is random. Those that do not reach it, or land where
 * the field degenerates, are taken away and drawn again; *removed counts them. Deterministic in
 * params->seed. Errors: no_surface when too few reach the surface, cancelled (the pool was told to stop). */
bool start_place(const field *f, const surface *scan, const solver_params *params, const level_plan *plan,
                 int level, double spacing, threads *pool, particles *p, size_t *removed, error *e);

#endif
