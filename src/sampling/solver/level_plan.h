// SPDX-License-Identifier: Apache-2.0
/* level_plan: the levels of a solve from the coarsest packing to the requested count. Also: the level on
 * which each connected part of the surface gets its first particles. */
#ifndef HEXAD_SAMPLING_SOLVER_LEVEL_PLAN_H
#define HEXAD_SAMPLING_SOLVER_LEVEL_PLAN_H

#include <stddef.h>
#include <stdint.h>

#include "surface/field/field.h"
#include "sampling/solver/curves/quota.h"
#include "sampling/solver/solver_params.h"
#include "sampling/sizing/curve_distance.h"
#include "surface/scan/surface.h"

#define LEVEL_PLAN_MAX 12

typedef struct level_plan {
    int count;                        /* levels, 1 to LEVEL_PLAN_MAX */
    size_t particles[LEVEL_PLAN_MAX]; /* per level, coarsest first; the last is the requested count */
    /* per level: its particles in parts without particles on the coarser level; coarsest: 0 */
    size_t new_parts[LEVEL_PLAN_MAX];
    /* Parts are ordered by the level on which they get particles: level k has the parts first[k] ..
     * first[k + 1] - 1. */
    size_t first[LEVEL_PLAN_MAX + 1];
    uint32_t *part; /* the parts in this order; NULL: all parts have particles from the coarsest level on */
    /* before[k], per entry of `part` and one more: fraction of all points in the parts part[0] .. part[k -
     * 1] */
    double *before;
    /* place[k], per entry of `part`: fraction of all points in the parts 0 .. part[k] - 1, in the
     * surface's own order */
    double *place;
    quota *quotas;          /* per level; NULL without patches */
    curve_distance *curves; /* distances from the curves of a patch; NULL without patches */
} level_plan;

/* Plans the solve of params->count particles on the scanned surface. The coarsest level resolves the
 * curvature of the surface and the gradient of the sizing field. A part with too few particles for a packing
 * of its own starts on a finer level, unless the start is random or the surface open. Deterministic in the
 * seed. Free *out also after failure. Errors: limit_memory, cancelled. */
bool level_plan_make(const field *f, const surface *scan, const solver_params *params, const threads *pool,
                     level_plan *out, error *e);
void level_plan_free(level_plan *l);

/* Maximum number of particles on all levels, copies on curves included. */
size_t level_plan_capacity(const level_plan *l);

/* Number of particles of a level, copies on curves included. */
static inline size_t level_plan_particles(const level_plan *l, int level)
{
    return l->quotas ? quota_particles(&l->quotas[level]) : l->particles[level];
}

/* Corrects the particle counts of the levels by `edges`, the number of edges of the coarsest packing.
 * `on_boundary`: the number of its particles on a boundary. A closed surface of Euler characteristic x has 3
 * (n - x) edges for n particles. An open surface has on_boundary edges fewer. The number of boundary
 * particles doubles from level to level. A finer level should have one new particle per edge of the
 * coarser level: each other new particle would be a defect. */
void level_plan_correct(level_plan *l, size_t edges, size_t on_boundary);

/* Removes the coarsest level. */
void level_plan_drop_coarsest(level_plan *l);

/* Fraction of all points in the parts that have particles on a level. */
double level_plan_share(const level_plan *l, int level);

/* The parameter of sizing_field_draw (0 to 1, in proportion to the points of all parts in the surface's own
 * order) that corresponds to `where`, 0 to 1, in proportion to the points of only the parts that get their
 * first particles on `level`. */
double level_plan_place(const level_plan *l, int level, double where);

#endif
