// SPDX-License-Identifier: Apache-2.0
/* solver: a particle system on a surface, from the initial positions to convergence, with global control.
 *
 *     solver *s = solver_new(...);                 // initial positions and neighbour lists
 *     while (!solver_ended(s)) solver_step(s, e);  // one action per step; the caller may stop after any step
 *     solver_finalize(s, e);                       // exact projection, normals, curvature, energies
 *     solver_result_points(s);                     // the result; solver_free at the end
 *
 * The caller owns the loop. Between two steps it may report the progress (solver_fraction, solver_sweeps,
 * solver_rounds), cancel the solve, or stop early and call solver_finalize. If the pool was stopped during a
 * step (threads_stopped), the step is incomplete: it returns true, or false with `cancelled`. After that only
 * solver_free is allowed.
 *
 * Steps allocate memory only for neighbour lists that grow, for refinement of a level and for inserted
 * particles. A solver is used by one thread at a time; it runs its work on the pool. Positions and lengths
 * are in world space.
 * The result depends on the field, the parameters and the seed, not on the number of threads.
 *
 * Sources: Meyer, Georgel, Whitaker 2005, sections 4 to 7; for comparison, the method of Witkin and Heckbert
 * 1994 behind the same interface.
 */
#ifndef HEXAD_SAMPLING_SOLVER_SOLVER_H
#define HEXAD_SAMPLING_SOLVER_SOLVER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/field/field.h"
#include "sampling/solver/solver_params.h"
#include "surface/scan/surface.h"

typedef struct solver solver;

typedef enum solver_outcome {
    SOLVER_RUNNING,
    SOLVER_CONVERGED,
    SOLVER_OUT_OF_SWEEPS, /* max_sweeps reached before the particles had converged */
    /* ended without convergence: with a threshold solver_round.gain above solver_coarsest_gain, or not
     * with the ideal energy */
    SOLVER_STALLED
} solver_outcome;

typedef struct solver_sweep {
    double energy; /* mean E_i over mean amplitude */
    double mean_log10_lambda;
    double rms_step; /* over the requested spacing */
    size_t count;
    double sigma;             /* support, world units */
    uint64_t rejected;        /* rejected trials */
    size_t inserted, deleted; /* fission and death, in the method of Witkin and Heckbert */
} solver_sweep;

/* E / E_ideal - 1 of a sweep. */
double solver_excess(const solver *s, const solver_sweep *sweep);

/* A round: consecutive sweeps, from one other action of the driver to the next (such as an adaptation of the
 * support, or a refinement). `regime` (at the end of the round), `cause` (why it began) and `ended` are words
 * of the report (doc/report.md#rounds-and-sweeps).
 */
typedef struct solver_round {
    const char *regime, *cause, *ended;
    double defect_fraction; /* after the least sweeps without extra ones; NAN: not computed in this round */
    bool extra_sweeps;      /* the level took more sweeps for its defects */
    int level, stage;       /* from 1; 1 is the coarsest level */
    int least_sweeps; /* minimum number of sweeps of the round, with extra sweeps; 0: it had no minimum */
    int sweeps;
    size_t inserted, deleted;
    double sigma; /* during the round */
    size_t count;
    double energy; /* at the end of the round, for its sigma */
    double gain;   /* threshold: a particle has converged if no step decreases its energy by this fraction */
} solver_round;

/* Minimum number of particles for steps with more than one thread. With fewer, the overhead exceeds the
 * gain. */
#define SOLVER_MIN_PARALLEL_COUNT 2000

/* Places the particles. `f`, `scan`, `pool`, and the sizing, curvature and energy of *params are owned by the
 * caller and outlive the solver; the rest of *params is copied or read here only. NULL on error:
 * limit_memory, no_surface (particles cannot be placed), not_supported (witkin_heckbert on a surface with
 * patches), cancelled. */
solver *solver_new(const field *f, const surface *scan, const solver_params *params, threads *pool, error *e);
void solver_free(solver *s);

/* One action of the driver: a sweep, or the action after a round. Must not be called once solver_ended is
 * true. After the last permitted sweep (max_sweeps) the solve ends with SOLVER_OUT_OF_SWEEPS; solver_finalize
 * projects and describes its particles all the same. A step sets whether the pool uses one thread
 * (threads_narrow, by the number of particles) and does not restore it: a caller that uses the pool
 * between steps sets it again. Errors: limit_memory, no_surface, cancelled. */
bool solver_step(solver *s, error *e);
bool solver_ended(const solver *s);
solver_outcome solver_result(const solver *s);

/* Estimated progress of the relaxation, 0 .. 1; it never decreases. */
double solver_fraction(const solver *s);

/* Sweeps and rounds up to now. The arrays are owned by the solver and valid until the next step. */
const solver_sweep *solver_sweeps(const solver *s, size_t *count);
const solver_round *solver_rounds(const solver *s, size_t *count);
double solver_spacing(const solver *s); /* h of the current level, world units */
/* solver_round.gain of the last round that max_sweeps did not interrupt; 0: there is none. A result with a
 * gain up to solver_coarsest_gain is converged. */
double solver_gain(const solver *s);
double solver_coarsest_gain(const solver *s);
/* Whether the energy of given points was so high that they took longer steps (solver_params.max_excess). */
bool solver_took_longer_steps(const solver *s);
/* Number of draws of initial positions that were repeated, plus number of relocations by the final
 * projection: of particles that cannot be projected, and of particles among the samples of a curve. */
size_t solver_removed_offsurface(const solver *s);

/* The particles between two steps. The arrays are owned by the solver and valid until the next step. With
 * patches, a point on a curve is one particle for each incident patch. */
typedef struct solver_particles {
    size_t count;
    const vec3 *position, *normal;
    double spacing;     /* h of the current level */
    const double *size; /* requested spacing over h; NULL: 1 for all */
} solver_particles;

solver_particles solver_current_particles(const solver *s);

/* Refines to the requested count if the solve was stopped on a coarser level, projects every particle onto
 * the surface to rounding and computes the result. A particle whose projection and relocation both fail stays
 * in the result, off the surface, and is counted in solver_points.lost. Errors: limit_memory, no_surface,
 * cancelled. */
bool solver_finalize(solver *s, error *e);

/* The points as the measures use them: a point on a curve has one copy for each incident patch, with that
 * patch's normal. The first solver_points.count entries are the points in their order; further copies follow.
 * Without patches the entries are the points, and the arrays from `patch` on are NULL. */
typedef struct solver_patch_points {
    size_t count;
    const vec3 *position, *normal;
    const double *spacing; /* requested */
    const uint32_t *patch;
    const uint32_t *point; /* per entry: its point */
    const uint32_t *place; /* per entry: particles.place; input of a continued solve (solver_params) */
    const uint8_t *flags;  /* of packing/packing.h */
} solver_patch_points;

/* Where a point lies: inside a patch, on a curve, or at a corner. */
typedef enum solver_feature { SOLVER_ON_PATCH, SOLVER_ON_CURVE, SOLVER_ON_CORNER } solver_feature;

/* The result. Arrays are indexed by point, if nothing else is stated. */
typedef struct solver_points {
    size_t count; /* lost points included */
    solver_patch_points patch_points;
    const uint8_t *feature; /* per point: solver_feature; NULL without patches */
    const uint32_t *patch;  /* per point; on a curve one of the incident patches; NULL without patches */
    const uint32_t *hint;   /* per point: for `sample_near` of the field of its patch; NULL without patches */
    const uint32_t *curve; /* indexed by patch_points.place: the curve of that sample; NULL without patches */
    const vec3 *position, *normal;
    const double *kappa, *kappa1, *kappa2, *alpha;
    /* curvature of (14) over a distance (params.curvature); NULL: it is the curvature at the point */
    const double *kappa_scale;
    /* E_i for the final sigma, summed over all neighbours (each pair counts for both points); with a sizing
     * field divided by the squared size */
    const double *energy;
    const double *spacing; /* requested */
    const bool *replaced;  /* relocated by the projection, or to fill a gap in coverage */
    size_t lost; /* number of points that are not on the surface, because they could not be relocated */
    double max_residual; /* max |F| / |grad F| over h */
    double sigma, mean_energy, ideal_energy, mean_neighbours;
    /* rms of the Newton steps at the points over the requested spacing (relax_rms_steps_left). NaN: unknown,
     * for example of an under-resolved surface, whose points are distributed in space after the
     * relaxation. */
    double step_left;
    double step_without_kinks; /* the same without particles that have converged on kinks */
} solver_points;

/* After solver_finalize; the arrays are owned by the solver. */
const solver_points *solver_result_points(const solver *s);

/* Moves the nearest free particle to each of `count` places and fixes it there. Call it after
 * solver_finalize, any number of times.
 *
 * A place is ignored unless it is within 1.5 spacings of the particle and on the particle's patch. It is also
 * ignored if a fixed particle on the same side (positive scalar product of the normals) is within 0.3
 * spacings of it.
 *
 * *goes_on: a particle was fixed. Then previous results are invalid, and the caller must run the solve to its
 * end and finalize it again. If *goes_on is false and the function returns true, nothing was changed and
 * results stay valid. This is so if no place is accepted, and always
 * - if the surface has no patches, or the solve has not converged (SOLVER_CONVERGED);
 * - if at least half of max_sweeps is used;
 * - if the solve started at given positions;
 * - if the surface is under-resolved.
 *
 * After an error previous results are invalid. Error: limit_memory. */
bool solver_pin(solver *s, const vec3 *place, size_t count, bool *goes_on, error *e);

/* The array solver_patch_points.position (which begins with solver_points.position), writable: for callers
 * that move the points off the zero set. Valid as long as the result. */
vec3 *solver_result_positions(solver *s);

#endif
