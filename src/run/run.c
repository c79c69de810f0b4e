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
static const size_t THREADS_FROM = 20000;
/* The range of sampling.count, for targets that come to a count. */
static const double COUNT_MIN = 4, COUNT_MAX = 1e8;

typedef struct job {
    const spec *spec;
    const run_options *options;
    progress progress;
    size_t memory; /* bytes, the job's limit */
    threads *pool;
    source source;
    surface *scan;
    grading *grading; /* NULL: even, or by alpha */
    size_t count;
    sampler *sampler;
    double *spacing_local;
    quality quality;
    json *report;
    results_facts results;
} job;

/* Also after a loop that was told to stop, which then says cancelled whatever the reason. */
static bool may_go_on(const job *j, error *e)
{
    int stop = j->options->cancel ? *j->options->cancel : 0;
    if (stop == SIGALRM)
        return error_set(e, ERROR_LIMIT_TIME, "the job did not end within limits.timeout_s = %g s",
                         j->spec->timeout_s);
    return stop == 0 || error_set(e, ERROR_CANCELLED, "the job was cancelled");
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
    if (workers > THREADS_MAX) workers = THREADS_MAX;
    j->pool = threads_new(workers, j->options->cancel, e);
    return j->pool && source_open(s, j->options->roots, j->memory, j->pool, &j->source, e);
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

static grading_kind grading_kind_of(const spec *s)
{
    if (s->has_grid) return s->grid.kind == SPEC_MAP_DENSITY ? GRADING_DENSITY : GRADING_SPACING;
    return s->curvature.chord_error > 0 ? GRADING_CHORD : GRADING_RATIO;
}

/* The spacing by place that sampling.curvature or sampling.grid asks for. */
static bool start_grading(job *j, error *e)
{
    const spec *s = j->spec;
    if (!s->has_curvature && !s->has_grid) return true;
    const grading_params params = {
        .kind = grading_kind_of(s),
        .chord_error = s->curvature.chord_error,
        .ratio = s->curvature.ratio,
        .exponent = s->curvature.exponent,
        .map = map_value,
        .map_context = j->source.map,
        .min_spacing = s->min_spacing,
        .max_spacing = s->max_spacing,
        .gradation = s->gradation,
    };
    j->grading = grading_new(j->source.field, j->scan, &params, j->count, j->pool, e);
    return j->grading != NULL;
}

static const char *const energy_names[] = {[SPEC_ENERGY_COTANGENT] = "cotangent",
                                           [SPEC_ENERGY_GAUSSIAN] = "gaussian",
                                           [SPEC_ENERGY_ELECTROSTATIC] = "electrostatic"};

static bool start(job *j, error *e)
{
    const spec *s = j->spec;
    progress_enter(&j->progress, PROGRESS_START);
    j->scan = surface_scan(j->source.field, j->pool, e);
    if (!j->scan || !resolve_count(j, e) || !start_grading(j, e)) return false;
    if (j->count < THREADS_FROM) threads_narrow(j->pool);
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
        .grading = j->grading,
        .sigma = s->sigma,
        .coarse_to_fine = s->method == SPEC_METHOD_SIZED,
        .energy = energy_find(energy_names[s->energy]),
        .gradient = s->minimiser == SPEC_MINIMISER_GRADIENT,
        .step = s->step,
        .list_limit = j->memory - source_memory(&j->source),
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
                              j->grading != NULL,
                              j->source.field->open,
                              j->source.field->rims};
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
                         json_put_array(j->report, "outputs"), &j->results, e);
}

static bool write_report(job *j, run_summary *out, error *e)
{
    const sampler_points *p = sampler_result_points(j->sampler);
    bool converged = sampler_result(j->sampler) == SAMPLER_CONVERGED && p->lost == 0;
    const report_facts facts = {
        j->spec,      &j->source, j->scan,
        j->grading,   j->sampler, &j->quality,
        &j->results,  converged,  threads_count(j->pool),
        &j->progress,
    };
    report_fill(j->report, &facts);
    if (!may_go_on(j, e) || !results_write_report(j->options->output, j->report, e)) return false;
    *out = (run_summary){converged, p->count, j->quality.hex_fraction, j->results.max_residual,
                         1e-3 * (double)(clock_monotonic_ms() - j->progress.start_ms)};
    return true;
}

/* Files of an earlier run in the same directory must not stand beside this one's report. */
static bool prepare_output(const char *directory, error *e)
{
    static const char *const names[] = {"report.json", "points.ply", "preview.png", "preview.exr"};
    bool ok = store_directory_create(directory, e);
    for (size_t k = 0; ok && k < sizeof names / sizeof names[0]; k++) {
        char *path = mem_printf("%s/%s", directory, names[k]);
        ok = store_remove(path, e);
        free(path);
    }
    return ok;
}

bool run_job(const spec *s, const run_options *options, run_summary *out, error *e)
{
    static bool (*const phases[])(job *, error *) = {load, start, relax_until_done, measure, write_results};
    job j = {.spec = s, .options = options};
    j.progress = progress_begin(options->progress_fd, options->progress_bar);
    bool ok = prepare_output(options->output, e);
    for (size_t k = 0; ok && k < sizeof phases / sizeof phases[0]; k++) {
        ok = phases[k](&j, e);
        if (!may_go_on(&j, e)) ok = false;
    }
    progress_end(&j.progress);
    ok = ok && write_report(&j, out, e);
    json_free(j.report);
    free(j.spacing_local);
    sampler_free(j.sampler);
    grading_free(j.grading);
    surface_free(j.scan);
    source_close(&j.source);
    threads_free(j.pool);
    return ok;
}
