// SPDX-License-Identifier: Apache-2.0
#include "job/phases/run.h"

#include <math.h>

#include "base/core/clock.h"
#include "geometry/space/packing.h"
#include "job/phases/attach.h"
#include "job/phases/job.h"
#include "job/report/report.h"
#include "job/source/plan.h"

static bool start(job *j, error *e)
{
    return job_survey(j, e) && job_place(j, &j->solution, e);
}

static bool relax(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_RELAX);
    if (!job_solve(j, e)) return false;
    return !j->spec->coherent || sequence_end(&j->sequence, solver_result_points(j->solution.solver), e);
}

/* Input of the outcome. Some methods do not produce an exact count. The support is chosen so that the mean
 * energy is ideal, unless the count determines it. */
static outcome_input outcome_input_of(const job *j)
{
    const solver *s = j->solution.solver;
    const solver_points *p = solver_result_points(s);
    const solver_outcome end = solver_result(s);
    size_t sweeps;
    const solver_sweep *sweep = solver_sweeps(s, &sweeps);
    const bool by_levels = j->spec->method == SPEC_METHOD_SIZED || plan_grades_by_levels(j->spec);
    return (outcome_input){
        .measures = &j->solution.measures,
        .stopped = end == SOLVER_RUNNING || end == SOLVER_OUT_OF_SWEEPS,
        .rms_step = sweeps > 0 ? sweep[sweeps - 1].rms_step : 0,
        .step_left = p->step_without_kinks,
        .step_tolerance = j->spec->step_tolerance,
        .is_blue_noise = j->spec->pattern == SPEC_PATTERN_BLUE_NOISE,
        .gain = solver_gain(s),
        .gain_tolerance = solver_coarsest_gain(s),
        .energy_error = by_levels ? 0 : fabs(p->mean_energy / p->ideal_energy - 1),
        .energy_tolerance = j->spec->energy_tolerance,
        .count_error = j->spec->has_control || j->count == 0 ? 0
                       : p->count > j->count                 ? p->count - j->count
                                                             : j->count - p->count,
        .lost = p->lost,
        .lost_area = source_missing_share(&j->source),
        .ringing = source_ringing(&j->source),
        .lost_walls = source_lost_share(&j->source),
        .residual = j->results.max_residual,
        .rms_residual = j->results.rms_residual,
        .require = j->spec->require,
    };
}

/* Measures the distances of opposite walls, if the report needs them. */
static bool measure_walls(job *j, solution *s, error *e)
{
    const outcome_input judged = outcome_input_of(j);
    const size_t count = solver_result_points(s->solver)->count;
    if (!report_needs_walls(&s->measures, count, outcome_evaluate(&judged).outcome)) return true;
    s->has_walls = clearance_measure(j->scan, s->sizing, packing_spacing(j->scan->area, (double)count),
                                     j->pool, MEASURES_THIN_SHARE, &s->walls, e);
    return s->has_walls;
}

static bool measure_result(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_MEASURE);
    source_end_solving(&j->source);
    return job_measure(j, &j->solution, e) && measure_walls(j, &j->solution, e);
}

static bool find_curvature(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_CURVATURE);
    return job_find_curvature(j, &j->solution, e);
}

static bool weigh(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_WEIGHTS);
    return job_weigh(j, &j->solution, e);
}

static bool write_results(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_WRITE);
    return job_write_points(j, e);
}

static bool write_report(job *j, outcome_kind *outcome, error *e)
{
    const solution *s = &j->solution;
    const delivery *to = &j->options->delivery;
    const outcome_input judged = outcome_input_of(j);
    const outcome_result v = outcome_evaluate(&judged);
    json *warnings = json_new_array();
    const report_facts facts = {
        .spec = j->spec,
        .source = &j->source,
        .attributes = attributes_describe(&j->attributes, warnings),
        .attribute_warnings = warnings,
        .scan = j->scan,
        .sizing = s->sizing,
        .curvature = s->curvature,
        .solver = s->solver,
        .count = j->avoided.taken ? j->avoided.taken_count : solver_result_points(s->solver)->count,
        .measures = &s->measures,
        .walls = s->has_walls ? &s->walls : NULL,
        .farthest = s->farthest,
        .landed = s->landed,
        .peak_memory = job_peak_memory(j),
        .memory_limit = (double)j->memory,
        .most_memory = (double)run_options_most_memory(j->options),
        .particle_memory = job_particle_memory(j),
        .particles = job_particles(j),
        .outputs = &j->results,
        .result = &v,
        .pool = j->pool,
        .isa = j->isa,
        .timing = job_timing(j),
    };
    report_fill(j->report, &facts);
    json_free(warnings);
    given_points_describe(&j->given, j->spec, j->report);
    weights_describe(&j->weights, j->report);
    avoided_points_describe(&j->avoided, j->report);
    if (j->spec->coherent)
        sequence_describe(&j->sequence, s->measures.energy_excess, solver_took_longer_steps(s->solver),
                          j->report);
    *outcome = v.outcome;
    return job_may_continue(j, e) && to->report(to->context, j->report, e);
}

bool run_job(const spec *s, const run_options *options, outcome_kind *outcome, json **report, error *e)
{
    static job_phase *const phases[] = {job_load,       start, relax,        measure_result,
                                        find_curvature, weigh, write_results};
    job j = {.spec = s, .options = options};
    if (s->attach) return attach_run(s, options, outcome, report, e);
    progress_begin(&j.progress, options->progress_fd, options->progress_bar, options->listener);
    snapshot_begin(&j.snapshot, options->progress_fd >= 0 ? options->output : NULL);
    bool ok = options->delivery.begin(options->delivery.context, e) &&
              job_run_phases(&j, phases, sizeof phases / sizeof *phases, e);
    progress_end(&j.progress);
    snapshot_end(&j.snapshot);
    ok = ok && write_report(&j, outcome, e);
    if (ok) {
        *report = j.report;
        j.report = NULL;
    }
    job_free(&j);
    return ok;
}
