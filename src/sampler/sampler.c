#include "sampler/sampler.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "geometry/morton.h"
#include "packing/energy.h"
#include "packing/packing.h"
#include "sampler/refine.h"
#include "sampler/sampler_internal.h"
#include "sampler/start.h"
#include "surface/boundary.h"
#include "surface/project.h"

/* For the estimate of progress: the share of a solve after which refined levels begin. */
static const double FINE_BEGINS = 0.4;

static schedule_position position(const sampler *s)
{
    return (schedule_position){s->level,           s->levels,   s->stage,
                               s->sweeps_in_round, s->p->count, s->params.sizing != NULL};
}

double sampler_amplitude(const sampler *s, double kappa)
{
    double k = fmin(kappa * s->field->extent, s->params.kappa_max);
    return s->params.gamma + 1 / (pow(k, s->params.d) + s->params.nu);
}

bool sampler_is_on_target(const sampler *s, double energy)
{
    return fabs(energy / s->params.energy->ideal - 1) < s->params.energy_tolerance;
}

static void amplitude_chunk(void *context, int worker, size_t begin, size_t end)
{
    sampler *s = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        field_sample sample;
        double kappa1, kappa2;
        if (field_sample_at(s->field, s->p->position[i], FIELD_HESSIAN, &sample))
            s->p->alpha[i] = sampler_amplitude(s, field_curvature(&sample, &kappa1, &kappa2));
    }
}

/* Amplitudes follow the particles at ever longer intervals: every sweep at first, when they move far, and
 * then after a quarter more sweeps each time. In between the energy is a function of positions alone, which
 * can only fall. */
static bool amplitudes_are_due(const sampler *s)
{
    return s->params.graded && s->sweep_count >= s->next_amplitudes;
}

/* Sums are made of at most so many parts, by the count alone. */
enum { SIZE_PARTS = 256, SIZE_BATCH = 64 };

typedef struct size_job {
    sampler *s;
    size_t grain;
    double squares[SIZE_PARTS]; /* of relative changes, a chunk each */
} size_job;

static void size_chunk(void *context, int worker, size_t begin, size_t end)
{
    size_job *job = context;
    sampler *s = job->s;
    double over_h = 1 / packing_spacing(s->scan->area, (double)s->params.count), squares = 0, spacing[SIZE_BATCH];
    (void)worker;
    for (size_t first = begin; first < end; first += SIZE_BATCH) {
        size_t count = end - first < SIZE_BATCH ? end - first : SIZE_BATCH;
        sizing_field_spacings(s->params.sizing, count, s->p->position + first, spacing);
        for (size_t k = 0; k < count; k++) {
            double *size = &s->p->size[first + k], change = *size / (spacing[k] * over_h) - 1;
            squares += change * change;
            *size = spacing[k] * over_h;
        }
    }
    job->squares[begin / job->grain] = squares;
}

double sampler_resize(sampler *s)
{
    if (!s->params.sizing) return 0;
    size_job job = {s, s->p->count / SIZE_PARTS + 1, {0}};
    double squares = 0;
    threads_run(s->pool, s->p->count, job.grain, size_chunk, &job);
    for (int k = 0; k < SIZE_PARTS; k++) squares += job.squares[k];
    return sqrt(squares / (double)s->p->count);
}

bool sampler_build_lists(sampler *s, error *e)
{
    if (amplitudes_are_due(s)) {
        threads_run(s->pool, s->p->count, 256, amplitude_chunk, s);
        s->next_amplitudes = s->sweep_count + 1 + s->sweep_count / 4;
    }
    sampler_resize(s);
    particles_mark_boundary(s->p, s->field, s->spacing);
    if (!relax_build(s->relax, s->p, s->sigma, s->skin, e)) return false;
    s->lists_stale = false;
    s->list_age = 0;
    return true;
}

/* The scales of the level at hand. */
static void enter_level(sampler *s, double support)
{
    s->spacing = packing_spacing(s->scan->area, (double)s->p->count);
    s->sigma = support * s->spacing;
    s->skin = s->schedule->skin_wide * s->spacing;
    s->gain = s->schedule->gain[s->stage];
}

/* Into an order in which neighbours are near each other in memory too. */
static bool arrange(sampler *s, error *e)
{
    uint32_t *order = mem_array(s->p->count, sizeof *order, "the order of particles", e);
    bool ok =
        order && morton_order(s->p->position, s->p->count, order, e) && particles_arrange(s->p, order, e);
    free(order);
    return ok;
}

static bool is_given(const sampler *s)
{
    return s->params.start == SAMPLER_START_GIVEN;
}

/* Places the particles, in an order for sweeps. */
static bool place(sampler *s, error *e)
{
    size_t removed;
    if (is_given(s)) {
        memcpy(s->p->position, s->params.given, s->p->count * sizeof *s->p->position);
        memcpy(s->p->normal, s->params.given_normal, s->p->count * sizeof *s->p->normal);
        return true;
    }
    if (!start_place(s->field, s->scan, &s->params, s->spacing, s->pool, s->p, &removed, e)) return false;
    s->removed += removed;
    return arrange(s, e);
}

/* Particles on the coarsest level, where they start. */
static bool begin(sampler *s, double support, error *e)
{
    s->p->count = s->level_count[0];
    enter_level(s, support);
    if (s->params.max_sigma > 0) s->sigma = fmin(s->sigma, s->params.max_sigma);
    if (!place(s, e)) return false;
    for (size_t i = 0; i < s->p->count; i++) s->p->lambda[i] = 0;
    return s->method->begin(s, e);
}

sampler *sampler_new(const field *f, const surface *scan, const sampler_params *params, threads *pool,
                     error *e)
{
    sampler *s = mem_alloc(sizeof *s);
    s->field = f;
    s->scan = scan;
    s->params = *params;
    s->method = params->witkin_heckbert ? &sampler_witkin_heckbert : &sampler_meyer;
    if (!params->energy) s->params.energy = &energy_cotangent;
    bool plain = params->coarse_to_fine && s->params.energy == &energy_cotangent && !params->graded &&
                 !params->gradient;
    s->fast = plain ? fast_kernel_for(params->isa) : NULL;
    s->schedule = !plain ? &schedule_paper : is_given(s) ? &schedule_continued : &schedule_multilevel;
    s->pool = pool;
    s->sweep = mem_array((size_t)params->max_sweeps, sizeof *s->sweep, "the record of sweeps", e);
    s->p = particles_new(params->count, e);
    s->relax = relax_new(params->count, s->params.energy, s->fast, params->list_limit, pool, e);
    if (!s->sweep || !s->p || !s->relax) goto fail;
    s->capacity = params->count;
    s->level_count[0] = params->count;
    s->stage = is_given(s) ? SCHEDULE_STAGES - 1 : 0;
    s->levels = params->coarse_to_fine && !is_given(s)
                    ? levels_plan(f, scan, params->sizing, params->count, params->seed, s->level_count)
                    : 1;
    /* a support that is given is meant for the whole count */
    double even = packing_spacing(scan->area, (double)params->count);
    if (!begin(s, params->sigma > 0 ? params->sigma / even : packing_support(1), e)) goto fail;
    return s;
fail:
    sampler_free(s);
    return NULL;
}

void sampler_free(sampler *s)
{
    if (!s) return;
    s->method->release(s);
    particles_free(s->p);
    relax_free(s->relax);
    free(s->sweep);
    free(s->replaced);
    free(s->column);
    free(s);
}

static size_t count_on_boundary(const sampler *s)
{
    size_t count = 0;
    for (size_t i = 0; i < s->p->count; i++) count += project_boundary_axes(s->field, s->p->position[i]) != 0;
    return count;
}

/* When the coarsest level does not see the surface for its edges the next finer one takes its place. */
static bool drop_coarsest(sampler *s, bool *again, error *e)
{
    *again = relax_creased_share(s->relax, s->p) > s->schedule->creased_share;
    if (!*again) return true;
    s->levels--;
    memmove(s->level_count, s->level_count + 1, (size_t)s->levels * sizeof *s->level_count);
    return begin(s, s->sigma / s->spacing, e);
}

/* Begins again with a better count once: the boundaries fill up only with time, so the last word is left to the
 * levels between. */
bool sampler_replan(sampler *s, bool *again, error *e)
{
    size_t count = s->p->count, edges;
    if (s->stage == 0) return drop_coarsest(s, again, e);
    if (!refine_count_edges(s->p, s->spacing, s->pool, &edges, e)) return false;
    levels_correct(s->level_count, s->levels, edges, count_on_boundary(s));
    *again = !s->planned && s->level_count[0] != count;
    s->planned = true;
    if (*again) return begin(s, s->sigma / s->spacing, e);
    s->level_count[0] = count;
    return true;
}

/* A level has come to rest: four times as many particles, with the support that it needed. */
bool sampler_refine(sampler *s, error *e)
{
    double support = s->sigma / s->spacing;
    if (!refine_particles(s->field, s->scan, s->params.sizing, s->p, s->level_count[++s->level], s->spacing,
                          s->params.seed, s->pool, e) ||
        !arrange(s, e))
        return false;
    enter_level(s, support);
    for (size_t i = 0; i < s->p->count; i++) s->p->lambda[i] = 0;
    return sampler_build_lists(s, e);
}

/* The share of a solve that a refined level of so many particles stands for: levels count by their particles, but for
 * the coarsest, which takes more sweeps. */
static double share_of(const sampler *s, size_t count)
{
    return FINE_BEGINS + (1 - FINE_BEGINS) * (double)count / (double)s->params.count;
}

static void estimate_fraction(sampler *s, const schedule_evidence *seen)
{
    double low = 0, high = 1;
    if (s->levels > 1) {
        low = s->level == 0 ? 0 : share_of(s, s->level_count[s->level - 1]);
        high = s->level == 0 ? FINE_BEGINS : share_of(s, s->level_count[s->level]);
    }
    const schedule_position at = position(s);
    s->fraction = fmax(s->fraction, low + (high - low) * schedule_level_progress(s->schedule, &at, seen));
}

/* At rest under sizes of a while ago, most of all: with those of now there may be more to do, unless the next
 * level does it. */
static bool sizes_are_settled(sampler *s)
{
    if (s->level > 0 && s->level < s->levels - 1) return true;
    if (sampler_resize(s) < s->schedule->size_settled || s->resizes == s->schedule->resizes_most) return true;
    s->resizes++;
    s->lists_stale = true;
    for (size_t i = 0; i < s->p->count; i++) s->p->lambda[i] = 0;
    return false;
}

/* A line of the record. */
static void note_sweep(sampler *s, const relax_sums *sums)
{
    double alpha = 0;
    for (size_t i = 0; i < s->p->count; i++) alpha += s->p->alpha[i];
    alpha /= (double)s->p->count;
    s->sweep[s->sweep_count++] = (sampler_sweep){.energy = sums->energy / alpha,
                                                 .mean_log10_lambda = sums->mean_log10_lambda,
                                                 .rms_step = sums->rms_step,
                                                 .count = s->p->count,
                                                 .sigma = s->sigma,
                                                 .rejected = sums->rejected};
}

static bool relax_step(sampler *s, error *e)
{
    if (s->lists_stale && !sampler_build_lists(s, e)) return false;
    schedule_position at = position(s);
    const relax_params params = {.field = s->field,
                                 .minimiser = s->params.gradient ? RELAX_GRADIENT : RELAX_LEVENBERG_MARQUARDT,
                                 .step = s->params.step,
                                 .sigma = s->sigma,
                                 .spacing = s->spacing,
                                 .omega = schedule_omega(s->schedule, &at),
                                 .fast_step = schedule_longest_step(s->schedule, &at),
                                 .gain = s->gain};
    relax_sums sums;
    relax_sweep(s->relax, s->p, &params, &sums);
    at.sweeps = ++s->sweeps_in_round;
    note_sweep(s, &sums);
    const schedule_evidence seen = {sums.rms_step, sums.mean_log10_lambda, !s->params.gradient,
                                    s->params.step_tolerance};
    estimate_fraction(s, &seen);
    if (schedule_is_impatient(s->schedule, &at)) s->gain *= 10;
    s->lists_stale =
        schedule_wants_lists(s->schedule, &at, sums.cramped, ++s->list_age) || amplitudes_are_due(s);
    s->skin = schedule_skin(s->schedule, sums.rms_step) * s->spacing;
    if (schedule_is_at_rest(s->schedule, &at, &seen) && sizes_are_settled(s) && !sampler_control(s, e))
        return false;
    if (s->outcome == SAMPLER_RUNNING && s->sweep_count == (size_t)s->params.max_sweeps)
        s->outcome = SAMPLER_OUT_OF_SWEEPS;
    return true;
}

/* What a result holds by this method is what every result holds. */
static bool describe_nothing(sampler *s, error *e)
{
    (void)s;
    (void)e;
    return true;
}

static void release_nothing(sampler *s)
{
    (void)s;
}

const sampler_method sampler_meyer = {sampler_build_lists, relax_step, describe_nothing, release_nothing};

bool sampler_step(sampler *s, error *e)
{
    return s->method->step(s, e);
}

bool sampler_ended(const sampler *s)
{
    return s->outcome != SAMPLER_RUNNING;
}

sampler_outcome sampler_result(const sampler *s)
{
    return s->outcome;
}

const sampler_sweep *sampler_sweeps(const sampler *s, size_t *count)
{
    *count = s->sweep_count;
    return s->sweep;
}

const sampler_round *sampler_rounds(const sampler *s, size_t *count)
{
    *count = s->round_count;
    return s->round;
}

double sampler_fraction(const sampler *s)
{
    return s->fraction;
}

double sampler_excess(const sampler *s, const sampler_sweep *sweep)
{
    return sweep->energy / s->params.energy->ideal - 1;
}

double sampler_spacing(const sampler *s)
{
    return s->spacing;
}

size_t sampler_removed_offsurface(const sampler *s)
{
    return s->removed;
}
