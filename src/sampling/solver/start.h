// SPDX-License-Identifier: Apache-2.0
/* start: initial positions of particles on a surface. */
#ifndef HEXAD_SAMPLING_SOLVER_START_H
#define HEXAD_SAMPLING_SOLVER_START_H

#include "sampling/solver/level_plan.h"
#include "sampling/solver/particles/particles.h"
#include "sampling/solver/solver_params.h"

/* Minimum distance of new particles from boundaries and curves, in spacings: half the distance of the first
 * lattice row. A nearer particle would move among the particles that are held there. */
#define START_CLEARANCE 0.45

enum {
    START_CLEAR_DRAWS =
        20, /* draws after which a particle may be nearer than START_CLEARANCE: the surface may be too
             * narrow */
    START_MAX_DRAWS = 1000 /* per particle; about a fifth of random draws fail */
};

/* Places p->count particles, with normals, on the parts of the surface that get their first particles on a
 * level. The first particles are samples of the boundaries of an open surface, or of the curves of patches. A
 * particle whose projection fails, or ends at a degenerate zero of the field, is drawn again; *removed counts
 * these draws. `spacing`: h, world units. Deterministic in params->seed. Errors: no_surface (too few draws
 * reach the surface), limit_memory, cancelled. */
bool start_place(const field *f, const surface *scan, const solver_params *params, const level_plan *plan,
                 int level, double spacing, threads *pool, particles *p, size_t *removed, error *e);

#endif
