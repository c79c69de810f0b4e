/* solver: a particle system on a surface, from start to rest, under global control.
 *
 *     solver *s = solver_new(...);            // particles placed, lists built
 *     while (!solver_ended(s)) solver_step(s, e);  // one action each; the caller may stop at any
 *     solver_finalize(s, e);                     // exact projection, normals, curvature, energies
 *
 * The caller owns the loop, the progress and the cancellation; a pool that is told to stop leaves a step
 * undone, and the caller is to end. Steps allocate nothing, but for lists that grow where particles crowd,
 * for the refinement of a level and where particles are inserted. Same field, parameters and seed give the
 * same result for any number of threads. Source: Meyer, Georgel, Whitaker 2005, sections 4 to 7; and, to be
 * compared with, the method of Witkin and Heckbert 1994 under the same interface.
 */
#ifndef HEXAD_SOLVER_SOLVER_H
#define HEXAD_SOLVER_SOLVER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "field/field.h"
#include "solver/solver_params.h"
#include "surface/surface.h"

typedef struct solver solver;

typedef enum solver_outcome {
    SOLVER_RUNNING,
    SOLVER_CONVERGED,
    SOLVER_OUT_OF_SWEEPS, /* max_sweeps done */
    SOLVER_STALLED /* at rest only with a coarse gain, or without the energy aimed at; lost points do not count */
} solver_outcome;

typedef struct solver_sweep {
    double energy; /* mean E_i over mean alpha */
    double mean_log10_lambda;
    double rms_step; /* over the requested spacing */
    size_t count;
    double sigma;
    uint64_t rejected;
    size_t inserted, deleted; /* by Witkin and Heckbert's method, which does so at any time */
} solver_sweep;

/* E / E_ideal - 1 of a sweep. */
double solver_excess(const solver *s, const solver_sweep *sweep);

/* Sweeps between two actions of the driver. `regime` (at its end), `began` and `ended` are words of the report
 * (doc/report.md#rounds-and-sweeps). */
typedef struct solver_round {
    const char *regime, *began, *ended;
    double defect_fraction; /* after the regular sweeps of the level; NAN: not computed in this round */
    bool extra_sweeps;      /* the level took more sweeps for its defects */
    int sweeps;
    size_t inserted, deleted;
    double sigma; /* in force during the round */
    size_t count;
    double energy; /* at its end, under its sigma */
    double gain;   /* no particle could lower its energy by more than this fraction */
} solver_round;

/* With fewer particles than so many a step runs on one thread: further ones cost more than they bring. */
#define SOLVER_THREADS_FROM 2000

/* `f`, `scan` and `pool` stay the caller's and outlive the solver; steps make the pool narrow or not, by their particles. Errors:
 * limit_memory, no_surface (particles cannot be placed). */
solver *solver_new(const field *f, const surface *scan, const solver_params *params, threads *pool, error *e);
void solver_free(solver *s);

bool solver_step(solver *s, error *e); /* one sweep, and control when a round ends */
bool solver_ended(const solver *s);
solver_outcome solver_result(const solver *s);

/* An estimate of how much of the relaxation is done, 0 .. 1, never falling. */
double solver_fraction(const solver *s);

/* The record so far; arrays belong to the solver and live until the next step. */
const solver_sweep *solver_sweeps(const solver *s, size_t *count);
const solver_round *solver_rounds(const solver *s, size_t *count);
double solver_spacing(const solver *s); /* h of the ideal packing */
/* The gain of the last round that ended otherwise than by max_sweeps; 0: there is none. A result is converged up to
 * solver_coarsest_gain. */
double solver_gain(const solver *s);
double solver_coarsest_gain(const solver *s);
size_t solver_removed_offsurface(const solver *s);

/* The particles between two steps; the arrays belong to the solver and live until the next step. On a surface with patches, a point on a
 * curve is one particle for each patch there. */
typedef struct solver_particles {
    size_t count;
    const vec3 *position, *normal;
    double spacing;     /* h of the current level */
    const double *size; /* requested spacing over h; NULL: 1 each */
} solver_particles;

solver_particles solver_current_particles(const solver *s);

/* Puts every particle on the surface to rounding, and computes what the output holds. A particle that
 * cannot be put there counts as lost. Errors: limit_memory, cancelled. */
bool solver_finalize(solver *s, error *e);

/* Points as measures see them. Of a surface with patches a point on a curve stands once for each patch there, with that
 * patch's normal; the first `solver_points.count` are the points, in their order, and then come the others that stand for
 * some. Without patches they are the points, and what is NULL says nothing. */
typedef struct solver_patch_points {
    size_t count;
    const vec3 *position, *normal;
    const double *spacing; /* requested */
    const uint32_t *patch; /* NULL: no patches, nor in the next */
    const uint32_t *point; /* of each, its point */
    const uint32_t *place; /* to be given again, see solver_params */
    const uint8_t *flags;  /* of packing/packing.h */
} solver_patch_points;

typedef enum solver_feature { SOLVER_ON_PATCH, SOLVER_ON_CURVE, SOLVER_ON_CORNER } solver_feature;

typedef struct solver_points {
    size_t count;
    solver_patch_points patch_points;
    const uint8_t *feature; /* solver_feature of each; NULL: no patches */
    const uint32_t *patch;  /* of each; on a curve one of those there; likewise */
    const uint32_t *curve;  /* of each place (stands.place) the curve; likewise */
    const vec3 *position, *normal;
    const double *kappa, *kappa1, *kappa2, *alpha;
    const double
        *kappa_scale;      /* the curvature of (14), over a distance; NULL where it is that at the point */
    const double *energy;  /* E_i, full sum under the final sigma; with a grading over the size squared */
    const double *spacing; /* requested */
    const bool *replaced;  /* put on a new place since it was lost */
    size_t lost;           /* not on the surface, and no place found for them */
    double max_residual;   /* max |F| / |grad F|, over h */
    double sigma, mean_energy, ideal_energy, mean_neighbours;
    /* rms of the Newton steps that are left to the points, over the requested spacing (relax_rms_steps_left); NaN where
     * no such step is known, as of a coarse answer, whose points are put at a distance from each other at last */
    double step_left;
    double
        step_to_rest; /* the same without particles that rest on kinks, where no step makes the energy less */
} solver_points;

/* After solver_finalize; the arrays belong to the solver. */
const solver_points *solver_result_points(const solver *s);

/* After solver_finalize, on a surface with patches: of a solve that has converged the particle that is nearest to each place,
 * within 1.5 spacings and on its patch, goes there and is held, unless another that is held or on a curve is near. The solve goes
 * on and is to be brought to its end again. *goes_on: there is one, and the solve has half of its sweeps left. The points of before
 * are void then, and after an error. Errors: limit_memory. */
bool solver_pin(solver *s, const vec3 *place, size_t count, bool *goes_on, error *e);

/* Positions of the result's stands, for who delivers the points elsewhere than on the zero set. */
vec3 *solver_result_positions(solver *s);

#endif
