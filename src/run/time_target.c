#include "run/time_target.h"

#include <math.h>

#include "base/clock.h"
#include "run/cost_model.h"
#include "source/plan.h"

/* With a time for a target what comes after a relaxation may take this many times what is expected. */
static const double TAIL_SLACK = 1.3;
/* A run whose time is up before it is at rest is a result all the same when its steps (rms, of h) are below
 * this: its points no longer change places. */
static const double STEP_FIT = 0.01;
/* Of the particles that memory holds: the last result is kept beside the run that may replace it. */
static const double TWO_RUNS = 0.8;

/* One run of j->count points that is to be over when no more than reserve_s are left. *late, with *out empty:
 * it was not, and its points are not fit to be a result. */
static bool run_in_time(job *j, cost_model *p, double reserve_s, solution *out, bool *late, error *e)
{
    int64_t begin = clock_monotonic_ms();
    *late = false;
    if (!job_place(j, out, e) ||
        !job_relax(j, out->solver, reserve_s + TAIL_SLACK * cost_model_rest(p, j->count), e))
        return false;
    size_t sweeps;
    const solver_sweep *last = solver_sweeps(out->solver, &sweeps) + sweeps - 1;
    *late = !solver_ended(out->solver) && (last->rms_step > STEP_FIT || 2 * last->count < j->count);
    if (*late) {
        job_free_solution(out);
        return true;
    }
    int64_t relaxed = clock_monotonic_ms();
    if (!job_finalize(j, out, e) || !job_measure(j, out, e)) return false;
    int64_t end = clock_monotonic_ms();
    cost_model_note(p, j->count, clock_seconds(end - begin), clock_seconds(end - relaxed));
    return true;
}

/* The first run is written, so that it is known how long that takes. */
bool time_target_fill(job *j, error *e)
{
    double memory = job_particle_memory(j) / job_bytes_per_particle(j) * TWO_RUNS, write_s = 0;
    cost_model p = cost_model_begin((size_t)fmin(fmax(memory, PLAN_COUNT_MIN), PLAN_COUNT_MAX));
    for (j->count = COST_MODEL_FIRST; j->count > 0;
         j->count = cost_model_next(&p, job_seconds_left(j) - write_s)) {
        solution next = {0};
        bool late;
        /* to write a point takes less than to measure it */
        if (!run_in_time(j, &p, write_s + cost_model_rest(&p, j->count), &next, &late, e)) {
            job_free_solution(&next);
            return false;
        }
        if (late) break;
        job_free_solution(&j->solution);
        j->solution = next;
        if (p.runs > 1) continue;
        int64_t begin = clock_monotonic_ms();
        if (!job_write_points(j, e)) return false;
        write_s = TAIL_SLACK * clock_seconds(clock_monotonic_ms() - begin);
    }
    if (p.runs > 0 && job_seconds_left(j) > 0) return true;
    return error_set(e, ERROR_LIMIT_TIME,
                     "/sampling/time_s: %d points of this surface and the outputs take longer than %g s: "
                     "raise it, or omit the preview",
                     COST_MODEL_FIRST, j->spec->time_s);
}
