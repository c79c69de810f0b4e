/* job: a running job and its phases. Private to run.c (runs the phases), time_target.c (relaxation when the target is a
 * time) and estimate.c (what a job would take). One thread at a time; phases use the job's pool. */
#ifndef HEXAD_RUN_JOB_H
#define HEXAD_RUN_JOB_H

#include "measures/measures.h"
#include "run/attributes.h"
#include "run/progress.h"
#include "run/results.h"
#include "run/run_options.h"
#include "run/sequence.h"
#include "run/snapshot.h"
#include "source/source.h"
#include "solver/solver.h"

/* A particle system at rest and its measures. */
typedef struct solution {
    sizing_field *sizing;        /* NULL: even, or by alpha */
    scaled_curvature *curvature; /* of alpha; NULL: the field's own */
    solver *solver;
    double *spacing_local;
    double *degree; /* NULL: no picture shows it */
    uint32_t (
        *corner)[3]; /* the triangles between the points on a closed mesh that is to be resolved; else NULL */
    size_t triangles;
    measures measures;
    double *farthest; /* the coverage of each patch */
    double landed;    /* the largest distance by which points were moved onto a mesh; 0 without one */
} solution;

typedef struct job {
    const spec *spec;
    const run_options *options;
    progress progress;
    snapshot snapshot;
    size_t memory; /* bytes, the job's limit */
    threads *pool;
    isa isa;
    source source;
    attributes attributes; /* that the points carry */
    int64_t
        load_peak; /* bytes of memory while inputs were loaded: of this process and of the largest of its readers */
    surface *scan;
    curve_distance *curves;    /* where they are finer than the rest; else NULL */
    sizing_field *by_features; /* with sampling.feature, of the whole count */
    size_t count; /* points that the target asks for; with a time as target: points of the next run */
    solution solution;
    sequence sequence; /* with queue.coherent */
    int64_t end_ms;    /* with a time as target: when the job must end */
    json *report;
    results_facts results;
} job;

/* A phase of a job. Errors: those of run_job. */
typedef bool job_phase(job *j, error *e);

/* False once the job must stop; the error is cancelled or limit_time. Call it after every loop that a stop ends: such a
 * loop reports cancelled for both. */
bool job_may_go_on(const job *j, error *e);

/* Opens the inputs: the pool, the instruction set, the frame before, and the source. */
bool job_load(job *j, error *e);

/* Scans the surface and computes the count from the target, unless the target is a time; makes the sizing field where
 * features bound it. */
bool job_survey(job *j, error *e);

/* Places j->count particles; with a previous frame, that frame's points. Free *out after failure, too. */
bool job_place(job *j, solution *out, error *e);

/* Sweeps until the system is at rest. With a time as target, ends also when only `reserve_s` of it are left. */
bool job_relax(job *j, solver *s, double reserve_s, error *e);

/* Makes the points final: on the surface to rounding, or on the triangles of its mesh. */
bool job_finalize(job *j, solution *s, error *e);

/* Of points that are final, on a closed mesh that is to be resolved: where their triangles leave out too much of it points are held,
 * and all come to rest again. */
bool job_reach(job *j, solution *s, error *e);

/* Measures a solution whose points are final. */
bool job_measure(job *j, solution *s, error *e);

/* Writes all results except the report, and starts a new report. */
bool job_write_points(job *j, error *e);

/* Runs phases in order, with a watchdog, until one fails or the job must stop. */
bool job_run_phases(job *j, job_phase *const *phases, size_t count, error *e);

/* With a time as target: seconds that are left. */
double job_seconds_left(const job *j);

double job_particle_memory(const job *j);
double job_bytes_per_particle(const job *j);

/* Bytes of memory at the peak: the worker's, or while it loaded the worker's and its reader's together, if that is more. */
int64_t job_peak_memory(const job *j);

/* Bytes of memory that the worker holds now. */
int64_t job_held_memory(void);

void job_free_solution(solution *s);
void job_free(job *j);

#endif
