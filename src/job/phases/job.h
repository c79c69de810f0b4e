// SPDX-License-Identifier: Apache-2.0
/* job: a running job and its phases. Private to run.c (runs the phases), time_target.c (relaxation when the
 * target is a time) and estimate.c (resources that a job would take). One thread at a time; phases use the
 * job's pool.
 */
#ifndef HEXAD_JOB_PHASES_JOB_H
#define HEXAD_JOB_PHASES_JOB_H

#include "sampling/measures/measures.h"
#include "sampling/sizing/clearance.h"
#include "job/phases/attributes.h"
#include "job/phases/avoided_points.h"
#include "job/phases/given_points.h"
#include "job/phases/point_order.h"
#include "job/phases/progress.h"
#include "job/phases/results_input.h"
#include "job/phases/run_options.h"
#include "job/phases/sequence.h"
#include "job/phases/snapshot.h"
#include "job/phases/weights.h"
#include "job/source/plan.h"
#include "job/source/source.h"
#include "sampling/solver/solver.h"

/* A converged particle system and its measures. */
typedef struct solution {
    sizing_field *sizing;        /* NULL: uniform spacing, or by alpha */
    scaled_curvature *curvature; /* with alpha at a scale; NULL: the field's own curvature */
    solver *solver;
    double *spacing_local;
    double *degree;        /* number of Voronoi neighbours of each point; NULL: no picture shows it */
    uint32_t (*corner)[3]; /* triangles between the points on a closed mesh with `resolve`; otherwise NULL */
    size_t triangles;
    measures measures;
    clearance walls; /* if has_walls: see report_needs_walls */
    bool has_walls;
    double *farthest;           /* coverage of each patch, see coverage_measure */
    point_curvature *on_meshes; /* NULL: no part of the surface is a mesh, or no result has the curvature */
    double *kappa;              /* with these values: kappa, then kappa1, then kappa2 of all points */
    point_order_known order_known;
    /* largest distance by which a point was projected onto a mesh, world units; 0 without a mesh */
    double landed;
} solution;

typedef struct job {
    const spec *spec;
    const run_options *options;
    progress progress;
    snapshot snapshot;
    size_t memory; /* limit of the job, bytes */
    threads *pool;
    isa isa;
    source source;
    attributes attributes; /* carried by the points */
    weights weights;       /* of the points, if they are requested */
    given_points given;
    avoided_points avoided;
    /* Bytes of memory while inputs were loaded: this process plus the largest of its readers. */
    int64_t load_peak;
    surface *scan;
    curve_distance *curves;    /* distance from curves, if the spacing is finer at curves; otherwise NULL */
    sizing_field *by_features; /* with sampling.feature: sizing field for the total count */
    size_t count;              /* points for the target */
    solution solution;
    sequence sequence; /* with queue.coherent */
    json *report;
    report_outputs results;
} job;

/* A phase of a job. Errors: those of run_job. */
typedef bool job_phase(job *j, error *e);

/* False if the job must stop; the error is cancelled or limit_time. Called after every loop that can be
 * stopped: such a loop reports cancelled for both. */
bool job_may_continue(const job *j, error *e);

/* Sets the memory limit and creates the pool. */
bool job_make_pool(job *j, error *e);

/* Creates the pool, chooses the instruction set, and opens the previous frame and the source. */
bool job_load(job *j, error *e);

/* Scans the surface and computes the count from the target. Makes the sizing field if features bound it. */
bool job_survey(job *j, error *e);

/* Places j->count particles, or the points of the previous frame. Free *out after failure, too. */
bool job_place(job *j, solution *out, error *e);

/* Sweeps until the system has converged. */
bool job_relax(job *j, solver *s, error *e);

/* Projects the points onto the surface to rounding, or onto the triangles of its mesh. */
bool job_finalize(job *j, solution *s, error *e);

/* Relaxes the placed particles until the points of the result are final. */
bool job_solve(job *j, error *e);

/* Measures a solution whose points are final. */
bool job_measure(job *j, solution *s, error *e);

/* Computes the weights of the points of a measured solution, if they are requested. */
bool job_weigh(job *j, const solution *s, error *e);

/* Computes the curvature of the points on meshes, if results have it. */
bool job_find_curvature(job *j, solution *s, error *e);

/* Writes all results except the report, and starts a new report. Requires job_find_curvature. */
bool job_write_points(job *j, error *e);

/* Runs phases in order, with a watchdog, until one fails or the job must stop. */
bool job_run_phases(job *j, job_phase *const *phases, size_t count, error *e);

double job_particle_memory(const job *j);
plan_particles job_particles(const job *j);

/* Start and times of the phases. */
report_timing job_timing(const job *j);

/* Peak bytes of memory: of the worker alone, or of the worker and its reader while inputs were loaded,
 * whichever is larger. */
int64_t job_peak_memory(const job *j);

/* Current bytes of memory of the worker. */
int64_t job_held_memory(void);

void job_free_solution(solution *s);
void job_free(job *j);

#endif
