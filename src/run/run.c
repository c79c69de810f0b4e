#include "run/run.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/memory.h"
#include "base/threads.h"
#include "packing/packing.h"
#include "packing/quality.h"
#include "run/cost_model.h"
#include "run/progress.h"
#include "run/report.h"
#include "run/results.h"
#include "run/sequence.h"
#include "run/source.h"
#include "run/watchdog.h"
#include "sampler/sampler.h"
#include "store/file.h"
#include "surface/surface.h"

/* What a particle takes at the peak, from particles and neighbour lists: measured at 200 bytes on smooth
 * surfaces; where they crowd their lists are longer. */
static const double BYTES_PER_PARTICLE = 300;
/* Of the method of Witkin and Heckbert, whose widest particle sets the length of all lists: 2.1 and 4.7
 * kB. */
static const double BYTES_PER_PARTICLE_SWARM = 5000;
/* Of a mesh: two triangles, six corners as their points see them, and the triangles once more while they
 * grow. */
static const double BYTES_PER_VERTEX = 120;
/* Of a points grid: OpenVDB's index, tree and attributes, and the file twice in memory. */
static const double BYTES_PER_GRID_POINT = 200;
/* Of a frame that is carried over: places for births and their lists, beside the points before. */
static const double BYTES_PER_CARRIED = 800;
/* Likewise of the preview's pixels. */
static const double BYTES_PER_PIXEL = 20;
/* Below this many points a second thread costs more than it brings. */
static const size_t THREADS_FROM = 20000;
/* The range of sampling.count, for targets that come to a count. */
static const double COUNT_MIN = 4, COUNT_MAX = 1e8;

/* With a time for a target what comes after a relaxation may take this many times what is expected. */
static const double TAIL_SLACK = 1.3;
/* A run whose time is up before it is at rest is a result all the same when its steps (rms, of h) are below
 * this: its points no longer change places. */
static const double STEP_FIT = 0.01;
/* Of processor time, which others on the machine do not stretch: no run that only tells what the job's own would
 * take is begun if it should take longer, and none goes on after twice that. The most points tell best. */
static const double REHEARSAL_S = 1;
/* Each has so many times the points of the one before it, as levels have: so their coarsest is that of the job. */
static const size_t REHEARSAL_STRIDE = 4;

/* Of the particles that memory holds: the last result is kept beside the run that may replace it. */
static const double TWO_RUNS = 0.8;

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

static void free_solution(solution *s)
{
    sampler_free(s->sampler);
    sizing_field_free(s->sizing);
    free(s->spacing_local);
    free(s->degree);
    *s = (solution){0};
}

/* Also after a loop that was told to stop, which then says cancelled whatever the reason. */
static bool may_go_on(const job *j, error *e)
{
    int stop = j->options->cancel ? *j->options->cancel : 0;
    if (stop == SIGALRM)
        return error_set(e, ERROR_LIMIT_TIME, "the job did not end within limits.timeout_s = %g s",
                         j->spec->timeout_s);
    return stop == 0 || error_set(e, ERROR_CANCELLED, "the job was cancelled");
}

/* Bytes that particles may take. */
static double particle_memory(const job *j)
{
    const spec *s = j->spec;
    double pixels = s->has_preview ? (double)s->preview_width * s->preview_height * BYTES_PER_PIXEL : 0;
    return (double)j->memory - (double)source_memory(&j->source) - pixels;
}

static double bytes_per_particle(const job *j)
{
    /* one after the other */
    double more =
        fmax(j->spec->has_mesh ? BYTES_PER_VERTEX : 0, j->spec->has_points_vdb ? BYTES_PER_GRID_POINT : 0);
    if (j->options->previous) more = fmax(more, BYTES_PER_CARRIED);
    return more +
           (j->spec->method == SPEC_METHOD_WITKIN_HECKBERT ? BYTES_PER_PARTICLE_SWARM : BYTES_PER_PARTICLE);
}

static bool fits_memory(const job *j, double count, error *e)
{
    double particles = count * bytes_per_particle(j), memory = particle_memory(j);
    if (particles <= memory) return true;
    return error_set(
        e, ERROR_LIMIT_MEMORY,
        "%.0f points need about %.0f MB, the limit leaves %.0f MB beside surface and preview: raise "
        "limits.memory_mb",
        count, particles / (1 << 20), fmax(memory, 0) / (1 << 20));
}

/* The instruction set that the spec asks for. */
static bool choose_isa(const spec *s, isa *out, error *e)
{
    static const isa named[] = {
        [SPEC_ISA_PORTABLE] = ISA_PORTABLE, [SPEC_ISA_AVX2] = ISA_AVX2, [SPEC_ISA_AVX512] = ISA_AVX512};
    *out = s->isa == SPEC_ISA_AUTO ? isa_best() : named[s->isa];
    return isa_available(*out) ||
           error_set(e, ERROR_NOT_SUPPORTED, "solver.isa: this machine has no %s: use \"auto\"",
                     isa_name(*out));
}

static bool load(job *j, error *e)
{
    const spec *s = j->spec;
    progress_enter(&j->progress, PROGRESS_LOAD);
    j->memory = (size_t)(s->memory_mb > 0 ? s->memory_mb : j->options->memory_mb) << 20;
    if (!fits_memory(j, (double)s->count, e)) return false;
    int most = j->options->threads, workers = s->threads;
    if (workers <= 0) workers = most > 0 ? most : threads_available();
    if (most > 0 && workers > most) workers = most;
    if (workers > THREADS_MAX) workers = THREADS_MAX;
    j->pool = threads_new(workers, j->options->cancel, e);
    return j->pool && choose_isa(s, &j->isa, e) &&
           (!s->coherent || sequence_begin(&j->sequence, j->options->frame, j->options->previous, e)) &&
           source_open(s, j->options->roots, j->memory, j->isa, j->pool, &j->source, e);
}

static const char *target_pointer(const spec *s)
{
    return s->spacing > 0   ? "/sampling/spacing"
           : s->density > 0 ? "/sampling/density"
                            : "/sampling/control/max_sigma";
}

/* The count that the target asks for on a surface of this area. */
static bool resolve_count(job *j, error *e)
{
    const spec *s = j->spec;
    double area = j->scan->area, count = (double)s->count;
    if (s->spacing > 0) count = round(packing_count(area, s->spacing));
    if (s->density > 0) count = round(s->density * area);
    /* the packing whose support is max_sigma; "paper" gets there by itself */
    if (s->has_control)
        count = fmax((double)s->control.min_count,
                     ceil(packing_count_of_support(area, s->control.max_sigma)));
    if (count < COUNT_MIN || count > COUNT_MAX)
        return error_set(e, ERROR_SPEC_INVALID,
                         "%s asks for %.0f points on an area of %g, it must be %.0f to %.0f: give another %s",
                         target_pointer(s), count, area, COUNT_MIN, COUNT_MAX,
                         strrchr(target_pointer(s), '/') + 1);
    j->count = (size_t)count;
    return fits_memory(j, fmax(count, (double)s->control.start_count), e);
}

static sizing_field_kind sizing_field_kind_of(const spec *s)
{
    if (s->has_grid) return s->grid.kind == SPEC_MAP_DENSITY ? SIZING_FIELD_DENSITY : SIZING_FIELD_SPACING;
    return s->curvature.chord_error > 0 ? SIZING_FIELD_CHORD : SIZING_FIELD_RATIO;
}

/* The spacing by place that sampling.curvature or sampling.grid asks for. */
static bool start_sizing(const job *j, sizing_field **out, error *e)
{
    const spec *s = j->spec;
    if (!s->has_curvature && !s->has_grid) return true;
    const sizing_field_params params = {
        .kind = sizing_field_kind_of(s),
        .chord_error = s->curvature.chord_error,
        .ratio = s->curvature.ratio,
        .exponent = s->curvature.exponent,
        .map = map_value,
        .map_context = j->source.map,
        .min_spacing = s->min_spacing,
        .max_spacing = s->max_spacing,
        .gradation = s->gradation,
        .memory_limit = (size_t)fmax(particle_memory(j), 1),
    };
    *out = sizing_field_new(j->source.field, j->scan, &params, j->count, j->pool, e);
    return *out != NULL;
}

static const char *const energy_names[] = {[SPEC_ENERGY_COTANGENT] = "cotangent",
                                           [SPEC_ENERGY_GAUSSIAN] = "gaussian",
                                           [SPEC_ENERGY_ELECTROSTATIC] = "electrostatic"};

/* Places j->count particles: those of the frame before, if there are any. */
static bool place(job *j, solution *out, error *e)
{
    const spec *s = j->spec;
    if (!start_sizing(j, &out->sizing, e)) return false;
    threads_narrow(j->pool, j->count < THREADS_FROM);
    bool inserts = s->has_control && s->method == SPEC_METHOD_PAPER;
    int64_t start = s->control.start_count > 0 ? s->control.start_count : s->control.min_count;
    const spec_witkin_heckbert *w = &s->witkin_heckbert;
    const witkin_heckbert_params swarm = {w->alpha, w->e_hat, w->rho, w->phi,   w->beta,
                                          w->dt,    w->gamma, w->nu,  w->delta, w->sigma_max};
    const energy_function *energy = energy_find(energy_names[s->energy]);
    const frame_transfer_params carry = {
        .count = j->count,
        .sizing = out->sizing,
        .eased = energy == &energy_cotangent && !s->has_alpha && s->method != SPEC_METHOD_WITKIN_HECKBERT,
        .isa = j->isa,
        .seed = s->seed,
    };
    frame_transfer brought = {0};
    if (j->options->previous &&
        !sequence_transfer(&j->sequence, j->source.field, j->scan, carry, j->pool, &brought, e))
        goto done;
    const sampler_params params = {
        .given = brought.position,
        .given_normal = brought.normal,
        .witkin_heckbert = s->method == SPEC_METHOD_WITKIN_HECKBERT ? &swarm : NULL,
        .count = inserts ? (size_t)start : j->count,
        .max_sigma = inserts ? s->control.max_sigma : 0,
        .min_count = (size_t)s->control.min_count,
        .unbiased = s->control.selection == SPEC_SELECTION_RANDOM,
        .count_limit = (size_t)(particle_memory(j) / bytes_per_particle(j)),
        .start = brought.position              ? SAMPLER_START_GIVEN
                 : s->init == SPEC_INIT_RANDOM ? SAMPLER_START_RANDOM
                                               : SAMPLER_START_SURFACE,
        .random_in_cells = source_starts_in_cells(&j->source),
        .seed = s->seed,
        .graded = s->has_alpha,
        .d = s->alpha.d,
        .gamma = s->alpha.gamma,
        .nu = s->alpha.nu,
        .kappa_max = s->alpha.kappa_max,
        .sizing = out->sizing,
        .sigma = s->sigma,
        .coarse_to_fine = s->method == SPEC_METHOD_SIZED,
        .energy = energy,
        .isa = j->isa,
        .gradient = s->minimiser == SPEC_MINIMISER_GRADIENT,
        .step = s->step,
        .list_limit = j->memory - source_memory(&j->source),
        .max_sweeps = s->max_sweeps,
        .step_tolerance = s->step_tolerance,
        .energy_tolerance = s->energy_tolerance,
    };
    out->sampler = sampler_new(j->source.field, j->scan, &params, j->pool, e);
done:
    frame_transfer_free(&brought);
    return out->sampler != NULL;
}

/* How large the surface is, and how many points it takes. */
static bool survey(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_START);
    j->scan = surface_scan(j->source.field, j->pool, e);
    if (!j->scan) return false;
    return j->spec->time_s > 0 || resolve_count(j, e); /* with a time, runs of several counts are to come */
}

static bool start(job *j, error *e)
{
    return survey(j, e) && (j->spec->time_s > 0 || place(j, &j->solution, e));
}

static double seconds_left(const job *j)
{
    return 1e-3 * (double)(j->end_ms - clock_monotonic_ms());
}

static void show_progress(job *j, const sampler *s, const sampler_sweep *last, size_t sweeps)
{
    size_t rounds;
    sampler_rounds(s, &rounds);
    double fraction = j->spec->time_s > 0 ? 1 - seconds_left(j) / j->spec->time_s : sampler_fraction(s);
    progress_update(&j->progress,
                    &(progress_numbers){fraction, rounds, sweeps, last->count, sampler_excess(s, last),
                                        last->rms_step, last->mean_log10_lambda});
}

/* Until the system is at rest, or, when time is the target, no more than `reserve_s` of it are left. */
static bool relax_until_done(job *j, sampler *s, double reserve_s, error *e)
{
    while (!sampler_ended(s)) {
        if (!may_go_on(j, e) || !sampler_step(s, e)) return false;
        size_t sweeps;
        const sampler_sweep *last = sampler_sweeps(s, &sweeps) + sweeps - 1;
        show_progress(j, s, last, sweeps);
        if (j->spec->time_s > 0 && seconds_left(j) < reserve_s) break;
    }
    return true;
}

static bool measure(job *j, solution *s, error *e)
{
    const sampler_points *p = sampler_result_points(s->sampler);
    s->spacing_local = mem_array(p->count, sizeof *s->spacing_local, "the result", e);
    if (!s->spacing_local) return false;
    if (j->spec->has_preview && j->spec->preview_color == SPEC_COLOR_DEGREE) {
        s->degree = mem_array(p->count, sizeof *s->degree, "the result", e);
        if (!s->degree) return false;
    }
    const quality_input in = {p->count,
                              p->position,
                              p->normal,
                              p->alpha,
                              p->spacing,
                              sampler_spacing(s->sampler),
                              s->sizing != NULL,
                              j->source.field->open,
                              j->source.field->rims};
    return quality_measure(&in, j->pool, s->spacing_local, s->degree, &s->quality, e);
}

static bool write_points(job *j, error *e)
{
    const solution *s = &j->solution;
    const sampler_points *p = sampler_result_points(s->sampler);
    const points set = {.count = p->count,
                        .position = p->position,
                        .normal = p->normal,
                        .kappa = p->kappa,
                        .kappa1 = p->kappa1,
                        .kappa2 = p->kappa2,
                        .alpha = p->alpha,
                        .energy = p->energy,
                        .spacing = p->spacing,
                        .spacing_local = s->spacing_local,
                        .degree = s->degree,
                        .id = j->sequence.id,
                        .velocity = j->sequence.velocity};
    results_input in = {
        .spec = j->spec, .field = j->source.field, .set = &set, .h = sampler_spacing(s->sampler)};
    in.sweeps = sampler_sweeps(s->sampler, &in.sweep_count);
    json_free(j->report);
    j->report = json_new_object();
    return may_go_on(j, e) && results_write(j->options->output, &in, j->pool,
                                            json_put_array(j->report, "outputs"), &j->results, e);
}

/* One run of j->count points that is to be over when no more than reserve_s are left. *late, with *out empty:
 * it was not, and its points are not fit to be a result. */
static bool run_in_time(job *j, cost_model *p, double reserve_s, solution *out, bool *late, error *e)
{
    int64_t begin = clock_monotonic_ms();
    *late = false;
    if (!place(j, out, e) ||
        !relax_until_done(j, out->sampler, reserve_s + TAIL_SLACK * cost_model_rest(p, j->count), e))
        return false;
    size_t sweeps;
    const sampler_sweep *last = sampler_sweeps(out->sampler, &sweeps) + sweeps - 1;
    *late = !sampler_ended(out->sampler) && (last->rms_step > STEP_FIT || 2 * last->count < j->count);
    if (*late) {
        free_solution(out);
        return true;
    }
    int64_t relaxed = clock_monotonic_ms();
    if (!sampler_finalize(out->sampler, e) || !measure(j, out, e)) return false;
    int64_t end = clock_monotonic_ms();
    cost_model_note(p, j->count, 1e-3 * (double)(end - begin), 1e-3 * (double)(end - relaxed));
    return true;
}

/* Runs of ever more points, each from what those before it took, as long as one more fits into the time; the
 * last whole one is the result. The first is written, so that it is known how long that takes. */
static bool fill_time(job *j, error *e)
{
    double memory = particle_memory(j) / bytes_per_particle(j) * TWO_RUNS, write_s = 0;
    cost_model p = cost_model_begin((size_t)fmin(fmax(memory, COUNT_MIN), COUNT_MAX));
    for (j->count = COST_MODEL_FIRST; j->count > 0;
         j->count = cost_model_next(&p, seconds_left(j) - write_s)) {
        solution next = {0};
        bool late;
        /* to write a point takes less than to measure it */
        if (!run_in_time(j, &p, write_s + cost_model_rest(&p, j->count), &next, &late, e)) {
            free_solution(&next);
            return false;
        }
        if (late) break;
        free_solution(&j->solution);
        j->solution = next;
        if (p.runs > 1) continue;
        int64_t begin = clock_monotonic_ms();
        if (!write_points(j, e)) return false;
        write_s = TAIL_SLACK * 1e-3 * (double)(clock_monotonic_ms() - begin);
    }
    if (p.runs > 0 && seconds_left(j) > 0) return true;
    return error_set(
        e, ERROR_LIMIT_TIME,
        "/sampling/time_s: %d points of this surface, with everything that is written, take longer "
        "than %g s: allow more time, or do without the preview",
        COST_MODEL_FIRST, j->spec->time_s);
}

static bool relax(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_RELAX);
    if (j->spec->time_s > 0) return fill_time(j, e);
    const sampler *s = j->solution.sampler;
    return relax_until_done(j, j->solution.sampler, 0, e) && sampler_finalize(j->solution.sampler, e) &&
           (!j->spec->coherent || sequence_end(&j->sequence, sampler_result_points(s), e));
}

static bool measure_result(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_MEASURE);
    return j->spec->time_s > 0 || measure(j, &j->solution, e); /* runs in time have measured what they cost */
}

static bool write_results(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_WRITE);
    return write_points(j, e);
}

static bool write_report(job *j, run_summary *out, error *e)
{
    const solution *s = &j->solution;
    const sampler_points *p = sampler_result_points(s->sampler);
    bool converged = sampler_result(s->sampler) == SAMPLER_CONVERGED && p->lost == 0;
    const report_facts facts = {
        j->spec,     &j->source,   j->scan,
        s->sizing,   s->sampler,   &s->quality,
        &j->results, converged,    threads_count(j->pool),
        j->isa,      &j->progress,
    };
    report_fill(j->report, &facts);
    if (j->spec->coherent) sequence_describe(&j->sequence, j->report);
    if (!may_go_on(j, e) || !results_write_report(j->options->output, j->report, e)) return false;
    *out = (run_summary){converged, p->count, s->quality.hex_fraction, j->results.max_residual,
                         1e-3 * (double)(clock_monotonic_ms() - j->progress.start_ms)};
    return true;
}

/* Files of an earlier run in the same directory must not stand beside this one's report. */
static bool prepare_output(const char *directory, error *e)
{
    return store_directory_create(directory, e) && results_remove(directory, e);
}

/* The job is still busy; what it holds goes with the process. */
static void leave_job(void *context)
{
    const job *j = context;
    error e = {0};
    may_go_on(j, &e);
    results_clear(j->options->output);
    j->options->leave(&e);
}

typedef bool phase(job *j, error *e);

static bool run_phases(job *j, phase *const *phases, size_t count, error *e)
{
    const watchdog_params params = {&j->progress, j->options->cancel, j->options->leave ? leave_job : NULL,
                                    j};
    watchdog *w = watchdog_start(&params, e);
    bool ok = w != NULL;
    for (size_t k = 0; ok && k < count; k++) {
        ok = phases[k](j, e);
        if (!may_go_on(j, e)) ok = false;
    }
    watchdog_end(w);
    return ok;
}

static void free_job(job *j)
{
    json_free(j->report);
    free_solution(&j->solution);
    sequence_free(&j->sequence);
    surface_free(j->scan);
    source_close(&j->source);
    threads_free(j->pool);
}

bool run_job(const spec *s, const run_options *options, run_summary *out, error *e)
{
    static phase *const phases[] = {load, start, relax, measure_result, write_results};
    job j = {.spec = s, .options = options};
    progress_begin(&j.progress, options->progress_fd, options->progress_bar);
    j.end_ms = j.progress.start_ms + (int64_t)(1e3 * s->time_s);
    bool ok = prepare_output(options->output, e) && run_phases(&j, phases, sizeof phases / sizeof *phases, e);
    progress_end(&j.progress);
    ok = ok && write_report(&j, out, e);
    free_job(&j);
    return ok;
}

/* ---- what it would take */

/* One run of j->count points, noted unless the time is up before its end; whether it was noted. */
static bool rehearse_once(job *j, double end_s, cost_model *p)
{
    solution s = {0};
    double begin_s = clock_processor_s();
    bool ok = place(j, &s, NULL);
    while (ok && !sampler_ended(s.sampler))
        ok = may_go_on(j, NULL) && clock_processor_s() < end_s && sampler_step(s.sampler, NULL);
    ok = ok && sampler_finalize(s.sampler, NULL) && measure(j, &s, NULL);
    if (ok) cost_model_note(p, j->count, clock_processor_s() - begin_s, 0);
    free_solution(&s);
    return ok;
}

/* Why no runs of fewer points tell what the job takes; NULL: they do. */
static const char *rehearsal_obstacle(const job *j)
{
    return j->spec->has_control   ? "sampling.control finds the count on the way"
           : j->options->previous ? "points of the frame before are carried over, which cannot be tried with fewer"
                                  : NULL;
}

/* Seconds from the first point to the last measure; NAN when that cannot be told, since no run came to its end.
 * That a rehearsal fails is no fault of the job's. */
static double rehearse(job *j)
{
    size_t count = j->count, part = 1;
    double end_s = clock_processor_s() + 2 * REHEARSAL_S;
    cost_model p = cost_model_begin(count);
    while (count / part / REHEARSAL_STRIDE >= COST_MODEL_FIRST) part *= REHEARSAL_STRIDE;
    for (j->count = count / part; rehearse_once(j, end_s, &p) && part > 1; j->count = count / part) {
        part /= REHEARSAL_STRIDE;
        if (cost_model_run(&p, count / part) > REHEARSAL_S) break;
    }
    j->count = count;
    /* few points are run by one thread, see place */
    return p.runs > 0 ? cost_model_run(&p, count) / (count < THREADS_FROM ? 1 : threads_count(j->pool)) : NAN;
}

/* `missing`: why there are no seconds, NULL when there are. */
static json *describe_estimate(const job *j, double seconds, const char *missing)
{
    double memory = (double)j->memory - particle_memory(j) + (double)j->count * bytes_per_particle(j);
    json *o = json_new_object();
    if (j->count > 0)
        json_put_integer(o, "count", (int64_t)j->count);
    else
        json_put_null(o, "count");
    json_put_number(o, "area", j->scan->area);
    report_put_box(o, j->scan->box);
    json_put_integer(o, "memory_bytes", (int64_t)memory);
    if (isnan(seconds))
        json_put_null(o, "seconds");
    else
        json_put_number(o, "seconds", seconds);
    json_put_string(o, "seconds_missing", missing);
    json_put_integer(o, "threads", threads_count(j->pool));
    return o;
}

json *run_estimate(const spec *s, const run_options *options, error *e)
{
    static phase *const phases[] = {load, survey};
    json *estimate = NULL;
    job j = {.spec = s, .options = options};
    progress_begin(&j.progress, options->progress_fd, options->progress_bar);
    if (run_phases(&j, phases, sizeof phases / sizeof *phases, e)) {
        /* parts of it are done by all threads and parts by one: it took no longer than the clock says, which
         * others stretch, nor than all of its threads together */
        double passed_s = 1e-3 * (double)(clock_monotonic_ms() - j.progress.start_ms);
        double opened_s = fmin(clock_processor_s(), passed_s);
        const char *missing = NULL;
        double seconds = s->time_s; /* as the target it holds for all of the job */
        if (s->time_s <= 0) {
            missing = rehearsal_obstacle(&j);
            seconds = missing ? NAN : opened_s + rehearse(&j);
            if (isnan(seconds) && !missing)
                missing = "a run of few points did not end in the time that it was given";
        }
        if (may_go_on(&j, e)) estimate = describe_estimate(&j, seconds, missing);
    }
    progress_end(&j.progress);
    free_job(&j);
    return estimate;
}
