// SPDX-License-Identifier: Apache-2.0
/* estimate: the memory, CPU time and count that a job is expected to need, for the command `estimate`
 * (run.h, run_estimate). */
#include <math.h>
#include <stdlib.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "geometry/space/packing.h"
#include "sampling/measures/measures.h"
#include "sampling/solver/schedule.h"
#include "job/report/advice.h"
#include "job/phases/attach.h"
#include "job/phases/job.h"
#include "job/source/plan.h"
#include "job/source/source_report.h"
#include "job/report/report.h"
#include "job/phases/run.h"
#include "job/report/outcome.h"
#include "sampling/sizing/clearance.h"
#include "surface/scan/surface.h"

/* Counts of the trial runs: the count of the job over a power of 4, as the counts of levels are, so that the
 * coarsest level is that of the job. A trial has at most REHEARSAL_MOST points, a sixth of the time of 10
 * 000, and at least REHEARSAL_LEAST, a run of milliseconds. */
enum { REHEARSAL_STRIDE = 4, REHEARSAL_LEAST = 200, REHEARSAL_MOST = 4000 };
/* Limits of CPU time, which does not depend on other processes, after the placement of the points: for the first
 * trial, and for each of the others. Trials with fewer points follow only if the first one did not end. The
 * placement takes at most about as long as that of the job. Larger: slower jobs get an estimate, which takes
 * longer. */
static const double REHEARSAL_S[2] = {3, 1};
/* Minimum number of points for which threads, used by the finest levels, reduce the total time
 * significantly. */
static const size_t SHARED_FROM = 20000;
/* Minimum memory of a worker that has used OpenVDB: the library, and the initial heap (mem_begin). */
static const double BYTES_WITH_OPENVDB = 37 << 20;
/* Bytes per triangle or cell of the surface while the result is measured: its index, piece, normal and part of the
 * tree nodes (sampling/measures/facets). */
static const double BYTES_PER_FACET = 40;

/* Fitted to schedule_multilevel: after a change of its sweeps, fit this and PER_POINT again
 * (measurements/inputs/estimates.py).
 * Time of a sweep of a level with extra sweeps for its defects, over that of another sweep: later sweeps have fewer
 * guarded steps. Such a level takes at least the time of its minimum number of sweeps. Larger: longer estimates from
 * 5 000 points. */
static const double EXTRA_SHARE = 0.5;
/* Time of the work done once per point (insertion, projection, measurement), in particle updates. From the trial run to a million
 * points the time of the sweeps grows by 35 on the torus and 28 on a level set of a sphere, and by 39 with this value. Larger:
 * longer estimates from 50 000 points. */
static const double PER_POINT = 20;
/* Minimum number of points of the coarsest level (doc/method.md, multilevel schedule). */
enum { LEVEL_LEAST = 100 };

/* Seconds of a run: the placement of its points, its sweeps, what follows, and the weights of the points. Those of the sweeps
 * depend mostly on the count, those of the weights are proportional to it, and the others depend on the surface and its
 * curves. */
typedef struct run_cost {
    double place_s, relax_s, measure_s, weights_s;
} run_cost;

/* Runs j->count points. Returns whether the sweeps ended within limit_s. An error of the run is not an error of
 * the job. */
static bool rehearse_once(job *j, double limit_s, run_cost *out)
{
    solution s = {0};
    double begin_s = clock_processor_s();
    bool ok = job_place(j, &s, NULL);
    const double placed_s = clock_processor_s();
    while (ok && !solver_ended(s.solver))
        ok = job_may_continue(j, NULL) && clock_processor_s() < placed_s + limit_s &&
             solver_step(s.solver, NULL);
    double relaxed_s = clock_processor_s();
    ok = ok && job_finalize(j, &s, NULL) && job_measure(j, &s, NULL);
    double measured_s = clock_processor_s();
    ok = ok && job_weigh(j, &s, NULL);
    if (ok)
        *out = (run_cost){placed_s - begin_s, relaxed_s - placed_s, measured_s - relaxed_s,
                          clock_processor_s() - measured_s};
    job_free_solution(&s);
    return ok;
}

/* The reason why trial runs cannot predict the job; NULL: they can. */
static const char *rehearsal_obstacle(const job *j)
{
    return j->spec->has_points    ? "points are given, and trial runs would need fewer of them"
           : j->spec->has_control ? "sampling.control determines the count during the run"
           : j->options->previous
               ? "the points of the previous frame are carried over, and trial runs would need fewer "
                 "of them"
               : NULL;
}

/* Predicts a quantity proportional to the time up to the last sweep, in particle updates. `by_levels`: the
 * solve has levels (schedule_multilevel); otherwise the quantity is the count. */
static double relative_work(size_t count, bool by_levels)
{
    const schedule *s = &schedule_multilevel;
    double work = by_levels ? PER_POINT * (double)count : (double)count;
    for (size_t n = count; by_levels && n >= LEVEL_LEAST; n /= 4) {
        schedule_position at = {.levels = 1, .stage = SCHEDULE_STAGES - 1, .count = n};
        const double sweeps = schedule_level_sweeps(s, &at);
        at.has_many_defects = (double)n >= s->defects_count;
        work += (double)n * fmax(sweeps, EXTRA_SHARE * schedule_level_sweeps(s, &at));
    }
    return work;
}

/* Predicted seconds from the placement of points to the last measure, and those of the weights among them; NAN if no
 * trial run ended. */
static double rehearse(job *j, double *weights_s)
{
    const size_t count = j->count;
    const bool by_levels = j->spec->method == SPEC_METHOD_SIZED || plan_grades_by_levels(j->spec);
    size_t part = 1;
    const double most_threads = count < SHARED_FROM ? 1 : threads_count(j->pool);
    run_cost cost;
    while ((part == 1 || count / part > REHEARSAL_MOST) && count / part / REHEARSAL_STRIDE >= REHEARSAL_LEAST)
        part *= REHEARSAL_STRIDE;
    j->count = count / part;
    bool ended = rehearse_once(j, REHEARSAL_S[0], &cost);
    while (!ended && j->count / REHEARSAL_STRIDE >= REHEARSAL_LEAST) {
        j->count /= REHEARSAL_STRIDE;
        ended = rehearse_once(j, REHEARSAL_S[1], &cost);
    }
    const double more = relative_work(count, by_levels) / relative_work(j->count, by_levels),
                 grown = (double)count / (double)j->count;
    j->count = count;
    if (!ended) return NAN;
    *weights_s = cost.weights_s * grown / most_threads;
    return (cost.place_s + cost.relax_s * more + cost.measure_s) / most_threads + *weights_s;
}

static double measuring_memory(const job *j)
{
    const mesh *m = source_mesh(&j->source);
    return BYTES_PER_FACET * (double)(m ? m->triangle_count : j->scan->cells);
}

/* Peak memory of a job with `count` points, bytes: the maximum of loading and sampling. `held`: memory of the
 * surface without points. */
static double memory_for(const job *j, int64_t held, double count)
{
    double begin = fmax((double)held, j->spec->points_in[FILE_FORMAT_VDB] ? BYTES_WITH_OPENVDB : 0);
    return fmax((double)job_peak_memory(j), begin + plan_bytes(j->spec, job_particles(j), count) +
                                                measuring_memory(j) + plan_picture_memory(j->spec));
}

/* Adds warnings and advice on walls thinner than the spacing. For a graded spacing they are unknown before
 * the job. */
static void describe_resolution(const job *j, int64_t held, json *warnings, json *advice)
{
    clearance c;
    bool even = !spec_is_graded(j->spec);
    double h = packing_spacing(j->scan->area, (double)j->count);
    if (j->count == 0 || !even ||
        !clearance_measure(j->scan, NULL, h, j->pool, MEASURES_THIN_SHARE, &c, NULL) ||
        c.unresolved_share <= MEASURES_THIN_SHARE)
        return;
    const double thinnest = source_thinnest_wall(&j->source, j->spec);
    const advice_resolution to =
        advice_resolve(j->scan->area, j->count, advice_factor(&c, thinnest), thinnest);
    advice_append_resolution(advice, j->spec, j->scan->area, to,
                             &(advice_memory){memory_for(j, held, to.count) / (1 << 20),
                                              (double)j->memory / (1 << 20),
                                              (double)j->options->most_memory_mb});
    advice_put_walls(advice, warnings, j->spec, c.unresolved_share, true, to);
}

/* `weights_s`: the part of the seconds for the weights; NAN: unknown. `missing`: the reason why there are no seconds, or
 * NULL. */
static json *describe_estimate(const job *j, int64_t held, double seconds, double weights_s,
                               const char *missing)
{
    json *o = json_new_object();
    if (j->count > 0)
        json_put_integer(o, "count", (int64_t)(j->avoided.wanted > 0 ? j->avoided.wanted : j->count));
    else
        json_put_null(o, "count");
    json_put_number(o, "area", j->scan->area);
    report_put_box(o, source_box(&j->source, j->scan));
    json_put_integer(o, "memory_bytes", (int64_t)memory_for(j, held, (double)j->count));
    if (isnan(seconds))
        json_put_null(o, "seconds");
    else
        json_put_number(o, "seconds", clock_seconds(llround(1000 * seconds)));
    json_put_string(o, "seconds_missing", missing);
    if (spec_has_weight(j->spec) && !isnan(weights_s))
        json_put_number(o, "weights_seconds", clock_seconds(llround(1000 * weights_s)));
    json_put_integer(o, "threads", threads_count(j->pool));
    json *warnings = json_put_array(o, "warnings"), *unused = json_new_object();
    source_describe(&j->source, unused, unused, warnings);
    json_free(unused);
    report_warn_of_build(warnings, j->spec);
    describe_resolution(j, held, warnings, json_put_array(o, "advice"));
    return o;
}

json *run_estimate(const spec *s, const run_options *options, error *e)
{
    static job_phase *const phases[] = {job_load, job_survey};
    json *estimate = NULL;
    job j = {.spec = s, .options = options};
    if (s->attach) return attach_estimate(s, options, e);
    progress_begin(&j.progress, options->progress_fd, options->progress_bar, options->listener);
    if (job_run_phases(&j, phases, sizeof phases / sizeof *phases, e)) {
        /* Some work uses all threads, some only one. Its time is at most that of the clock, which other
         * processes lengthen, and at most the CPU time of all threads. */
        int64_t held = job_held_memory();
        double passed_s = clock_seconds(clock_monotonic_ms() - j.progress.start_ms);
        double opened_s = fmin(clock_processor_s(), passed_s);
        double weights_s = NAN;
        const char *missing = rehearsal_obstacle(&j);
        const double seconds = missing ? NAN : opened_s + rehearse(&j, &weights_s);
        if (isnan(seconds) && !missing)
            missing = "a trial run with few points did not end within its time limit";
        if (job_may_continue(&j, e)) estimate = describe_estimate(&j, held, seconds, weights_s, missing);
    }
    progress_end(&j.progress);
    job_free(&j);
    return estimate;
}
