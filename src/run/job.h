/* job: one job while it runs, and its steps. Private to run.c, which runs a job as a ladder of phases, time_target.c,
 * which runs the relaxation of one whose target is a time, and estimate.c, which looks at what a job would take.
 * One thread at a time; the steps use the job's pool. */
#ifndef HEXAD_RUN_JOB_H
#define HEXAD_RUN_JOB_H

#include "packing/quality.h"
#include "run/progress.h"
#include "run/results.h"
#include "run/run_options.h"
#include "run/sequence.h"
#include "run/source.h"
#include "sampler/sampler.h"

/* Below this many points a second thread costs more than it brings. */
#define JOB_THREADS_FROM 20000

/* A system at rest and what was measured of it. */
typedef struct solution {
    sizing_field *sizing; /* NULL: even, or by alpha */
    sampler *sampler;
    double *spacing_local;
    double *degree; /* NULL: no picture shows it */
    quality quality;
} solution;

typedef struct job {
    const spec *spec;
    const run_options *options;
    progress progress;
    size_t memory; /* bytes, the job's limit */
    threads *pool;
    isa isa;
    source source;
    surface *scan;
    size_t count; /* that the target asks for; of the next run, when it asks for time */
    solution solution;
    sequence sequence; /* with queue.coherent */
    int64_t end_ms;    /* with a time for a target: when the job is to be over */
    json *report;
    results_facts results;
} job;

/* A step of a job. Errors: those of the job contract. */
typedef bool job_phase(job *j, error *e);

/* False once the job was told to stop; the error says why: cancelled, or limit_time. To be asked after every loop that
 * a stop ends, since such a loop says cancelled whatever the reason. */
bool job_may_go_on(const job *j, error *e);

/* Opens the inputs: the pool, the instruction set, the frame before, and the source. */
bool job_load(job *j, error *e);

/* Scans the surface, and finds how many points the target asks for, unless the target is a time. */
bool job_survey(job *j, error *e);

/* Places j->count particles: those of the frame before, if there are any. Release *out also after failure. */
bool job_place(job *j, solution *out, error *e);

/* Sweeps until the system is at rest, or, when time is the target, no more than `reserve_s` of it are left. */
bool job_relax(job *j, sampler *s, double reserve_s, error *e);

/* Measures the quality of a solution whose points are final. */
bool job_measure(job *j, solution *s, error *e);

/* Writes all results but the report, and begins the report anew. */
bool job_write_points(job *j, error *e);

/* Runs phases one after the other beside a watchdog, as long as they succeed and the job may go on. */
bool job_run_phases(job *j, job_phase *const *phases, size_t count, error *e);

/* With a time for a target: what is left of it. */
double job_seconds_left(const job *j);

double job_particle_memory(const job *j);
double job_bytes_per_particle(const job *j);

void job_free_solution(solution *s);
void job_free(job *j);

#endif
