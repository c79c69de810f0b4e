#include "run/run.h"

#include <math.h>

#include "base/clock.h"
#include "base/memory.h"
#include "run/job.h"
#include "run/report.h"
#include "run/time_target.h"
#include "store/file.h"
#include "particles/curve_room.h"
#include "particles/coverage.h"

static bool start(job *j, error *e)
{
    return job_survey(j, e) && (j->spec->time_s > 0 || job_place(j, &j->solution, e));
}

static bool relax(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_RELAX);
    if (j->spec->time_s > 0) return time_target_fill(j, e);
    const sampler *s = j->solution.sampler;
    return job_relax(j, j->solution.sampler, 0, e) && job_finalize(j, &j->solution, e) &&
           job_reach(j, &j->solution, e) &&
           (!j->spec->coherent || sequence_end(&j->sequence, sampler_result_points(s), e));
}

static bool measure_result(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_MEASURE);
    if (!(j->spec->time_s > 0) && !job_measure(j, &j->solution, e))
        return false; /* runs in time have measured what they cost */
    const sampler_points *p = sampler_result_points(j->solution.sampler);
    solution *s = &j->solution;
    const size_t parts = coverage_parts(j->scan);
    s->farthest = mem_array(parts, sizeof *s->farthest, "the result", e);
    if (!s->farthest ||
        !coverage_measure(j->scan, p->position, p->spacing, p->count, j->pool, s->farthest, e))
        return false;
    s->coverage = 0;
    for (size_t k = 0; k < parts; k++) s->coverage = fmax(s->coverage, s->farthest[k]);
    const vec3 *thin = NULL;
    const size_t places = source_thin_places(&j->source, &thin);
    return coverage_of_places(thin, places, p->position, p->spacing, p->count, &s->coverage, e);
}

static bool write_results(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_WRITE);
    return job_write_points(j, e);
}

/* Where the report has to tell how fine a spacing would have to be. *out stays NULL where it has not. */
static bool find_clearance(const job *j, clearance *room, const clearance **out, error *e)
{
    const solution *s = &j->solution;
    if (!(quality_unresolved_share(&s->quality) > VERDICT_UNRESOLVED_SHARE)) return true;
    *out = room;
    return clearance_measure(j->scan, s->sizing, sampler_spacing(s->sampler), j->pool, room, e);
}

/* Likewise how much room there is beside curves. */
static bool find_curve_room(const job *j, double *out, error *e)
{
    const solution *s = &j->solution;
    return !j->scan->field->patches ||
           !verdict_is_near_boundaries(&s->quality, sampler_result_points(s->sampler)) ||
           curve_room_find(j->scan, sampler_spacing(s->sampler), out, e);
}

static bool write_report(job *j, verdict_outcome *outcome, error *e)
{
    const solution *s = &j->solution;
    clearance room;
    const clearance *told = NULL;
    double curve_room = 0;
    if (!find_clearance(j, &room, &told, e) || !find_curve_room(j, &curve_room, e)) return false;
    const verdict_input judged = {s->sampler,
                                  &s->quality,
                                  j->spec->has_control ? 0 : j->count,
                                  j->spec->step_tolerance,
                                  j->spec->energy_tolerance,
                                  source_missing_share(&j->source),
                                  j->results.max_residual,
                                  s->coverage,
                                  j->source.whole.labels && label_surface_has_thin(j->source.whole.labels)};
    const verdict v = verdict_judge(&judged);
    const report_facts facts = {
        .spec = j->spec,
        .source = &j->source,
        .attributes = &j->attributes,
        .scan = j->scan,
        .sizing = s->sizing,
        .curvature = s->curvature,
        .sampler = s->sampler,
        .quality = &s->quality,
        .coverage = s->coverage,
        .farthest = s->farthest,
        .landed = s->landed,
        .clearance = told,
        .curve_room = curve_room,
        .peak_memory = job_peak_memory(j),
        .memory_limit = (double)j->memory,
        .particle_memory = job_particle_memory(j),
        .bytes_per_particle = job_bytes_per_particle(j),
        .results = &j->results,
        .verdict = &v,
        .threads = threads_count(j->pool),
        .isa = j->isa,
        .progress = &j->progress,
    };
    report_fill(j->report, &facts);
    if (j->spec->coherent) sequence_describe(&j->sequence, j->report);
    *outcome = v.outcome;
    return job_may_go_on(j, e) && results_write_report(j->options->output, j->report, e);
}

/* Files of an earlier run in the same directory must not stand beside this one's report. */
static bool prepare_output(const char *directory, error *e)
{
    return store_directory_create(directory, e) && results_remove(directory, e);
}

bool run_job(const spec *s, const run_options *options, verdict_outcome *outcome, json **report, error *e)
{
    static job_phase *const phases[] = {job_load, start, relax, measure_result, write_results};
    job j = {.spec = s, .options = options};
    progress_begin(&j.progress, options->progress_fd, options->progress_bar);
    j.end_ms = j.progress.start_ms + (int64_t)(1e3 * s->time_s);
    bool ok =
        prepare_output(options->output, e) && job_run_phases(&j, phases, sizeof phases / sizeof *phases, e);
    progress_end(&j.progress);
    ok = ok && write_report(&j, outcome, e);
    if (ok) {
        *report = j.report;
        j.report = NULL;
    }
    job_free(&j);
    return ok;
}
