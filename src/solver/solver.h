/* solver: a particle system on a surface, from the initial positions to convergence, with global control.
 *
 *     solver *s = solver_new(...);                 // initial positions and neighbour lists
 *     while (!solver_ended(s)) solver_step(s, e);  // one action per step; the caller may stop after any step
 *     solver_finalize(s, e);                       // exact projection, normals, curvature, energies
 * The caller owns the loop, progress reports and cancellation. If the pool was stopped during a step, the step is incomplete and the caller must not
 * continue. Steps allocate memory only for neighbour lists that grow, for refinement of a level and for inserted particles. A solver is used by one
 * thread at a time; it runs its work on the pool. Positions and lengths are in world space.
 * The result depends on the field, the parameters and the seed, not on the number of threads.
 *
 * Sources: Meyer, Georgel, Whitaker 2005, sections 4 to 7; for comparison, the method of Witkin and Heckbert 1994 behind the same
 * interface.
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
    SOLVER_OUT_OF_SWEEPS, /* max_sweeps reached */
    SOLVER_STALLED        /* ended with a gain above solver_coarsest_gain, or not with the ideal energy */
} solver_outcome;

typedef struct solver_sweep {
    double energy; /* mean E_i over mean amplitude */
    double mean_log10_lambda;
    double rms_step; /* over the requested spacing */
    size_t count;
    double sigma;             /* world units */
    uint64_t rejected;        /* trials */
    size_t inserted, deleted; /* by the method of Witkin and Heckbert */
} solver_sweep;

/* E / E_ideal - 1 of a sweep. */
double solver_excess(const solver *s, const solver_sweep *sweep);

/* Sweeps between two actions of the driver. `regime` (at its end), `began` and `ended` are words of the report
 * (doc/report.md#rounds-and-sweeps). */
typedef struct solver_round {
    const char *regime, *began, *ended;
    double defect_fraction; /* after the regular sweeps of the level; NAN: not computed in this round */
    bool extra_sweeps;      /* the level took more sweeps for its defects */
    int level, stage;       /* from 1; 1 is the coarsest level */
    int least_sweeps;       /* of the level, extra sweeps included; 0: the round could end without them */
    int sweeps;
    size_t inserted, deleted;
    double sigma; /* during the round */
    size_t count;
    double energy; /* at the end of the round, for its sigma */
    double gain;   /* relative decrease of a particle's energy that counts as convergence */
} solver_round;

/* Minimum number of particles for steps with more than one thread. With fewer, the overhead exceeds the gain. */
#define SOLVER_MIN_PARALLEL_COUNT 2000

/* `f`, `scan` and `pool` are owned by the caller and outlive the solver. Steps set the width of the pool (threads_narrow). NULL on error: limit_memory,
 * no_surface (particles cannot be placed), not_supported (witkin_heckbert on a surface with patches), cancelled. */
solver *solver_new(const field *f, const surface *scan, const solver_params *params, threads *pool, error *e);
void solver_free(solver *s);

/* One action of the driver: a sweep, or the action after a round. Not after solver_ended. Errors: limit_memory, no_surface, cancelled. */
bool solver_step(solver *s, error *e);
bool solver_ended(const solver *s);
solver_outcome solver_result(const solver *s);

/* Estimated progress of the relaxation, 0 .. 1; it never decreases. */
double solver_fraction(const solver *s);

/* Sweeps and rounds up to now. The arrays are owned by the solver and valid until the next step. */
const solver_sweep *solver_sweeps(const solver *s, size_t *count);
const solver_round *solver_rounds(const solver *s, size_t *count);
double solver_spacing(const solver *s); /* h of the current level, world units */
/* The gain of the last round that max_sweeps did not interrupt; 0: there is none. A result with a gain up to solver_coarsest_gain is
 * converged. */
double solver_gain(const solver *s);
double solver_coarsest_gain(const solver *s);
/* Number of particles whose projection failed: initial positions that were drawn again, and relocated particles. */
size_t solver_removed_offsurface(const solver *s);

/* The particles between two steps. The arrays are owned by the solver and valid until the next step. With patches, a point on a curve is
 * one particle for each incident patch. */
typedef struct solver_particles {
    size_t count;
    const vec3 *position, *normal;
    double spacing;     /* h of the current level */
    const double *size; /* requested spacing over h; NULL: 1 for all */
} solver_particles;

solver_particles solver_current_particles(const solver *s);

/* Refines to the requested count if the solve was stopped on a coarser level, projects every particle onto the surface to rounding and computes the result. A particle whose projection and relocation fail is
 * lost. Errors: limit_memory, cancelled. */
bool solver_finalize(solver *s, error *e);

/* The points as the measures use them: a point on a curve has one copy for each incident patch, with that patch's normal. The first
 * solver_points.count entries are the points in their order; further copies follow. Without patches the entries are the points, and
 * the arrays from `patch` on are NULL. */
typedef struct solver_patch_points {
    size_t count;
    const vec3 *position, *normal;
    const double *spacing; /* requested */
    const uint32_t *patch;
    const uint32_t *point; /* per entry: its point */
    const uint32_t *place; /* per entry: particles.place; input of a continued solve (solver_params) */
    const uint8_t *flags;  /* of packing/packing.h */
} solver_patch_points;

typedef enum solver_feature { SOLVER_ON_PATCH, SOLVER_ON_CURVE, SOLVER_ON_CORNER } solver_feature;

typedef struct solver_points {
    size_t count;
    solver_patch_points patch_points;
    const uint8_t *feature; /* per point: solver_feature; NULL without patches */
    const uint32_t *patch;  /* per point; on a curve one of the incident patches; NULL without patches */
    const uint32_t *curve;  /* per curve sample (patch_points.place): its curve; NULL without patches */
    const vec3 *position, *normal;
    const double *kappa, *kappa1, *kappa2, *alpha;
    /* curvature of (14) over a distance; NULL: it is the curvature at the point */
    const double *kappa_scale;
    /* E_i, full sum for the final sigma; with a sizing field over the size squared */
    const double *energy;
    const double *spacing; /* requested */
    const bool *replaced;  /* per point: relocated after a failed projection */
    size_t lost;           /* points that are not on the surface and could not be relocated */
    double max_residual;   /* max |F| / |grad F| over h */
    double sigma, mean_energy, ideal_energy, mean_neighbours;
    /* rms of the Newton steps at the points over the requested spacing (relax_rms_steps_left). NaN: unknown, for example of an under-resolved
     * surface, whose points are distributed in space after the relaxation. */
    double step_left;
    double step_without_kinks; /* the same without particles that have converged on kinks */
} solver_points;

/* After solver_finalize; the arrays are owned by the solver. */
const solver_points *solver_result_points(const solver *s);

/* After solver_finalize of a converged solve on a surface with patches. Moves the nearest particle to each of `count` places and fixes it there. The
 * place must be within 1.5 spacings of the particle and on its patch; no particle is fixed within 0.3 spacings of another fixed one of the same side
 * (normals with a positive product). Other places are ignored. *goes_on: a particle was fixed. The caller must then run the solve to its end again, and previous results are invalid. Nothing is done
 * if at least half of max_sweeps is used, if the solve started at given positions, or if the surface is under-resolved. After an error previous results are invalid. Error: limit_memory. */
bool solver_pin(solver *s, const vec3 *place, size_t count, bool *goes_on, error *e);

/* Positions of the result's patch points, for callers that move the points off the zero set. */
vec3 *solver_result_positions(solver *s);

#endif
