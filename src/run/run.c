#include "run/run.h"

#include <math.h>
#include <stdlib.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/memory.h"
#include "base/threads.h"
#include "run/progress.h"
#include "run/report.h"
#include "run/results.h"
#include "run/source.h"
#include "sampler/quality.h"
#include "sampler/sampler.h"
#include "sampler/surface.h"
#include "store/file.h"

/* What a particle takes at the peak, from particles, neighbour lists, measures and the verification's second
 * copy: measured at 0.9 kB from a start on the surface, 1.5 kB from a random one, whose lists are longer. */
static const double BYTES_PER_PARTICLE = 1600;
/* Likewise of the preview's pixels. */
static const double BYTES_PER_PIXEL = 20;
/* Below this many points a second thread costs more than it brings. */
static const int64_t THREADS_FROM = 20000;
/* The range of sampling.count, for targets that come to a count. */
static const double COUNT_MIN = 4, COUNT_MAX = 1e8;

typedef struct job {
    const spec *spec;
    const run_options *options;
    progress progress;
    int64_t deadline_ms; /* monotonic; INT64_MAX: none */
    size_t memory;       /* bytes, the job's limit */
    threads *pool;
    source source;
    surface *scan;
    size_t count;
    sampler *sampler;
    double *spacing_local;
    quality quality;
    json *report;
    double max_residual;
} job;

static bool may_go_on(const job *j, error *e)
{
    if (j->options->cancel && *j->options->cancel)
        return error_set(e, ERROR_CANCELLED, "the job was cancelled");
    if (clock_monotonic_ms() > j->deadline_ms)
        return error_set(e, ERROR_LIMIT_TIME, "the job did not end within limits.timeout_s = %g s",
                         j->spec->timeout_s);
    return true;
}

static bool fits_memory(const job *j, double count, error *e)
{
    const spec *s = j->spec;
    double particles = count * BYTES_PER_PARTICLE;
    double pixels = s->has_preview ? (double)s->preview_width * s->preview_height * BYTES_PER_PIXEL : 0;
    double memory = (double)j->memory - (double)source_memory(&j->source);
    if (particles + pixels <= memory) return true;
    return error_set(
        e, ERROR_LIMIT_MEMORY,
        "%.0f points need about %.0f MB and their preview %.0f MB, the limit leaves %.0f MB: raise "
        "limits.memory_mb",
        count, particles / (1 << 20), pixels / (1 << 20), fmax(memory, 0) / (1 << 20));
}

static bool load(job *j, error *e)
{
    const spec *s = j->spec;
    progress_enter(&j->progress, PROGRESS_LOAD);
    j->memory = (size_t)(s->memory_mb > 0 ? s->memory_mb : j->options->memory_mb) << 20;
    if (!fits_memory(j, (double)s->count, e)) return false;
    int workers = s->threads > 0 ? s->threads : threads_available();
    if (s->threads == 0 && s->count > 0 && s->count < THREADS_FROM) workers = 1;
    j->pool = threads_new(workers, e);
    return j->pool && source_open(s, j->options->roots, j->memory, &j->source, e);
}

/* The count that the target asks for on a surface of this area. */
static bool resolve_count(job *j, error *e)
{
    const spec *s = j->spec;
    double area = j->scan->area, count = (double)s->count;
    if (s->spacing > 0) count = round(2 * area / (sqrt(3) * s->spacing * s->spacing));
    if (s->density > 0) count = round(s->density * area);
    if (count < COUNT_MIN || count > COUNT_MAX)
        return error_set(e, ERROR_SPEC_INVALID,
                         "%s asks for %.0f points on an area of %g, it must be %.0f to %.0f: give another %s",
                         s->spacing > 0 ? "/sampling/spacing" : "/sampling/density", count, area, COUNT_MIN,
                         COUNT_MAX, s->spacing > 0 ? "spacing" : "density");
    j->count = (size_t)count;
    return fits_memory(j, count, e);
}

static const char *const energy_names[] = {[SPEC_ENERGY_COTANGENT] = "cotangent",
                                           [SPEC_ENERGY_GAUSSIAN] = "gaussian",
                                           [SPEC_ENERGY_ELECTROSTATIC] = "electrostatic"};

static bool start(job *j, error *e)
{
    const spec *s = j->spec;
    progress_enter(&j->progress, PROGRESS_START);
    j->scan = surface_scan(j->source.field, j->pool, e);
    if (!j->scan || !resolve_count(j, e)) return false;
    const sampler_params params = {
        .count = j->count,
        .start = s->init == SPEC_INIT_RANDOM ? SAMPLER_START_RANDOM : SAMPLER_START_SURFACE,
        .random_in_cells = j->source.volume != NULL,
        .seed = s->seed,
        .graded = s->has_alpha,
        .d = s->alpha.d,
        .gamma = s->alpha.gamma,
        .nu = s->alpha.nu,
        .kappa_max = s->alpha.kappa_max,
        .sigma = s->sigma,
        .coarse_to_fine = s->method == SPEC_METHOD_SIZED,
        .energy = energy_find(energy_names[s->energy]),
        .gradient = s->minimiser == SPEC_MINIMISER_GRADIENT,
        .step = s->step,
        .max_sweeps = s->max_sweeps,
        .step_tolerance = s->step_tolerance,
        .energy_tolerance = s->energy_tolerance,
    };
    j->sampler = sampler_new(j->source.field, j->scan, &params, j->pool, e);
    return j->sampler != NULL;
}

static bool relax_until_done(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_RELAX);
    while (!sampler_ended(j->sampler)) {
        if (!may_go_on(j, e) || !sampler_step(j->sampler, e)) return false;
        size_t sweeps, rounds;
        const sampler_sweep *last = sampler_sweeps(j->sampler, &sweeps) + sweeps - 1;
        sampler_rounds(j->sampler, &rounds);
        progress_update(&j->progress, &(progress_numbers){sampler_fraction(j->sampler), rounds, sweeps,
                                                          last->count, sampler_excess(j->sampler, last),
                                                          last->rms_step, last->mean_log10_lambda});
    }
    return sampler_finish(j->sampler, e);
}

static bool measure(job *j, error *e)
{
    const sampler_points *p = sampler_result_points(j->sampler);
    progress_enter(&j->progress, PROGRESS_MEASURE);
    j->spacing_local = mem_array(p->count, sizeof *j->spacing_local, "the result", e);
    if (!j->spacing_local) return false;
    const quality_input in = {p->count,
                              p->position,
                              p->normal,
                              p->alpha,
                              p->spacing,
                              sampler_spacing(j->sampler),
                              j->source.field->open,
                              j->source.field->domain};
    return quality_measure(&in, j->pool, j->spacing_local, NULL, &j->quality, e);
}

static bool write_results(job *j, error *e)
{
    const sampler_points *p = sampler_result_points(j->sampler);
    const points set = {p->count,  p->position, p->normal, p->kappa,   p->kappa1,
                        p->kappa2, p->alpha,    p->energy, p->spacing, j->spacing_local};
    progress_enter(&j->progress, PROGRESS_WRITE);
    j->report = json_new_object();
    return may_go_on(j, e) &&
           results_write(j->options->output, j->spec, j->source.field, &set, sampler_spacing(j->sampler),
                         json_put_array(j->report, "outputs"), &j->max_residual, e);
}

static bool write_report(job *j, run_summary *out, error *e)
{
    const sampler_points *p = sampler_result_points(j->sampler);
    progress_end(&j->progress);
    bool converged = sampler_result(j->sampler) == SAMPLER_CONVERGED && p->lost == 0;
    const report_facts facts = {j->spec,     &j->source,      j->scan,   j->sampler,
                                &j->quality, j->max_residual, converged, threads_count(j->pool),
                                &j->progress};
    report_fill(j->report, &facts);
    if (!may_go_on(j, e) || !results_write_report(j->options->output, j->report, e)) return false;
    *out = (run_summary){converged, p->count, j->quality.hex_fraction, j->max_residual,
                         1e-3 * (double)(clock_monotonic_ms() - j->progress.start_ms)};
    return true;
}

/* A report of an earlier run in the same directory must not vouch for this one's files. */
static bool prepare_output(const char *directory, error *e)
{
    if (!store_directory_create(directory, e)) return false;
    char *report = mem_printf("%s/report.json", directory);
    bool ok = store_remove(report, e);
    free(report);
    return ok;
}

bool run_job(const spec *s, const run_options *options, run_summary *out, error *e)
{
    job j = {.spec = s, .options = options};
    j.progress = progress_begin(options->progress_fd, options->progress_bar);
    j.deadline_ms = s->timeout_s > 0 ? j.progress.start_ms + (int64_t)(1e3 * s->timeout_s) : INT64_MAX;
    bool ok = prepare_output(options->output, e) && load(&j, e) && start(&j, e) && relax_until_done(&j, e) &&
              measure(&j, e) && write_results(&j, e) && write_report(&j, out, e);
    json_free(j.report);
    free(j.spacing_local);
    sampler_free(j.sampler);
    surface_free(j.scan);
    source_close(&j.source);
    threads_free(j.pool);
    return ok;
}
