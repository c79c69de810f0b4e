#include "run/run.h"

#include "base/clock.h"
#include "run/job.h"
#include "run/report.h"
#include "run/time_target.h"
#include "store/file.h"

static bool start(job *j, error *e)
{
    return job_survey(j, e) && (j->spec->time_s > 0 || job_place(j, &j->solution, e));
}

static bool relax(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_RELAX);
    if (j->spec->time_s > 0) return time_target_fill(j, e);
    const sampler *s = j->solution.sampler;
    return job_relax(j, j->solution.sampler, 0, e) && sampler_finalize(j->solution.sampler, e) &&
           (!j->spec->coherent || sequence_end(&j->sequence, sampler_result_points(s), e));
}

static bool measure_result(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_MEASURE);
    return j->spec->time_s > 0 ||
           job_measure(j, &j->solution, e); /* runs in time have measured what they cost */
}

static bool write_results(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_WRITE);
    return job_write_points(j, e);
}

static bool write_report(job *j, run_summary *out, error *e)
{
    const solution *s = &j->solution;
    const sampler_points *p = sampler_result_points(s->sampler);
    const verdict_input judged = {s->sampler, &s->quality, j->spec->has_control ? 0 : j->count,
                                  j->spec->step_tolerance, j->spec->energy_tolerance};
    const verdict v = verdict_judge(&judged);
    const report_facts facts = {
        j->spec,     &j->source,   j->scan,
        s->sizing,   s->sampler,   &s->quality,
        &j->results, &v,           threads_count(j->pool),
        j->isa,      &j->progress,
    };
    report_fill(j->report, &facts);
    if (j->spec->coherent) sequence_describe(&j->sequence, j->report);
    if (!job_may_go_on(j, e) || !results_write_report(j->options->output, j->report, e)) return false;
    *out = (run_summary){v, p->count, s->quality.hex_fraction, j->results.max_residual,
                         clock_seconds(clock_monotonic_ms() - j->progress.start_ms)};
    return true;
}

/* Files of an earlier run in the same directory must not stand beside this one's report. */
static bool prepare_output(const char *directory, error *e)
{
    return store_directory_create(directory, e) && results_remove(directory, e);
}

bool run_job(const spec *s, const run_options *options, run_summary *out, error *e)
{
    static job_phase *const phases[] = {job_load, start, relax, measure_result, write_results};
    job j = {.spec = s, .options = options};
    progress_begin(&j.progress, options->progress_fd, options->progress_bar);
    j.end_ms = j.progress.start_ms + (int64_t)(1e3 * s->time_s);
    bool ok =
        prepare_output(options->output, e) && job_run_phases(&j, phases, sizeof phases / sizeof *phases, e);
    progress_end(&j.progress);
    ok = ok && write_report(&j, out, e);
    job_free(&j);
    return ok;
}
