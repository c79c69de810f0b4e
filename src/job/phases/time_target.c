// SPDX-License-Identifier: Apache-2.0
#include "job/phases/time_target.h"

#include <math.h>

#include "base/core/clock.h"
#include "job/phases/cost_model.h"
#include "job/source/plan.h"

/* Safety factor for the predicted time of the work after the relaxation. */
static const double TAIL_SLACK = 1.3;
/* A run that is stopped before convergence is still a valid result if its rms step, in units of h, is below
 * this: its points keep their neighbours. */
static const double STEP_FIT = 0.01;
/* Fraction of the particles that memory permits: the last result is kept during the run that may replace
 * it. */
static const double TWO_RUNS = 0.8;

/* One run of j->count points, which ends when at most reserve_s seconds are left. *late, with *out empty: it
 * did not converge in time, and its points are not a valid result. */
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

/* Runs with an increasing number of points. The results of the first run are written, to measure the time of
 * writing. */
bool time_target_fill(job *j, error *e)
{
    double memory = TWO_RUNS * plan_fitting(j->spec, job_particles(j), job_particle_memory(j)), write_s = 0;
    cost_model p = cost_model_begin((size_t)fmin(fmax(memory, PLAN_COUNT_MIN), PLAN_COUNT_MAX));
    for (j->count = COST_MODEL_FIRST; j->count > 0;
         j->count = cost_model_next(&p, job_seconds_left(j) - write_s)) {
        solution next = {0};
        bool late;
        /* writing a point takes less time than measuring it */
        if (!run_in_time(j, &p, write_s + cost_model_rest(&p, j->count), &next, &late, e)) {
            job_free_solution(&next);
            return false;
        }
        if (late) break;
        job_free_solution(&j->solution);
        j->solution = next;
        if (p.runs > 1) continue;
        int64_t begin = clock_monotonic_ms();
        if (!job_find_curvature(j, &j->solution, e) || !job_weigh(j, &j->solution, e) ||
            !job_write_points(j, e))
            return false;
        write_s = TAIL_SLACK * clock_seconds(clock_monotonic_ms() - begin);
    }
    if (p.runs > 0 && job_seconds_left(j) > 0) return true;
    return error_set(e, ERROR_LIMIT_TIME,
                     "/sampling/time_s: %d points of this surface and the outputs take longer than %g s: "
                     "raise it, or omit the preview",
                     COST_MODEL_FIRST, j->spec->time_s);
}
