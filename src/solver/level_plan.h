/* levels: how many particles to solve for, from the coarsest packing to the count that was asked for, and on which level
 * each connected part of the surface gets its first particles. */
#ifndef HEXAD_SOLVER_LEVELS_H
#define HEXAD_SOLVER_LEVELS_H

#include <stddef.h>
#include <stdint.h>

#include "field/field.h"
#include "solver/curves/quota.h"
#include "solver/solver_params.h"
#include "sizing/curve_distance.h"
#include "surface/surface.h"

#define LEVEL_PLAN_MAX 12

typedef struct level_plan {
    int count;                        /* 1 to LEVEL_PLAN_MAX */
    size_t particles[LEVEL_PLAN_MAX]; /* of each level, coarsest first; the last is what was asked for */
    size_t new_parts
        [LEVEL_PLAN_MAX]; /* of these, in parts that have none on the coarser level; 0 on the coarsest */
    /* the parts in the order in which they get particles: those of level k from first[k] to first[k + 1] */
    size_t first[LEVEL_PLAN_MAX + 1];
    uint32_t *part; /* NULL: all of the surface from the coarsest level on */
    double *
        before; /* share in all points of the parts before each in this order; one more than there are parts */
    double *place; /* share of the parts before each in the order of the surface */
    /* of a surface with patches, else NULL: of each level, and how far places are from their patch's curves */
    quota *quotas;
    curve_distance *curves;
} level_plan;

/* Plans the solve of params->count particles on the scanned surface. The coarsest level is still fine enough for the
 * surface's curvature and for the grading. A part whose share of a level is too small for a packing of its own waits for a
 * finer one, unless the start is random or the surface open. Free *out after failure, too. Error: limit_memory.
 * Deterministic in the seed. */
bool level_plan_plan(const field *f, const surface *scan, const solver_params *params, level_plan *out,
                     error *e);
void level_plan_free(level_plan *l);

/* Room that the particles need on the way to the finest level. */
size_t level_plan_capacity(const level_plan *l);

/* How many particles a level has, copies on curves included. */
static inline size_t level_plan_particles(const level_plan *l, int level)
{
    return l->quotas ? quota_particles(&l->quotas[level]) : l->particles[level];
}

/* Corrects the plan by the edges that the coarsest packing turned out to have, `on_boundary` of whose particles lie on
 * a boundary. A closed surface of Euler characteristic x has 3 (n - x) edges for n particles, an open one fewer by
 * its boundary particles, which double from level to level. Off by what refining would have to invent, a level
 * begins with as many defects. */
void level_plan_correct(level_plan *l, size_t edges, size_t on_boundary);

/* Leaves the coarsest level out. */
void level_plan_drop_coarsest(level_plan *l);

/* The share in all points of the parts that have some on a level. */
double level_plan_share(const level_plan *l, int level);

/* A place among the parts that get their first particles on a level, 0 to 1, as a place among all: in proportion to the
 * points that they are to have, as sizing_field_draw counts them. */
double level_plan_place(const level_plan *l, int level, double where);

#endif
