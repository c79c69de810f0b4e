#include "sampler/sampler.h"

#include <assert.h>
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
#include "surface/projection.h"

/* For the estimate of progress: the share of a solve after which refined levels begin. */
static const double FINE_BEGINS = 0.4;

static schedule_position position(const sampler *s)
{
    return (schedule_position){s->state.level,           s->state.levels,   s->state.stage,
                               s->state.sweeps_in_round, s->state.p->count, s->setup.params.sizing != NULL};
}

double sampler_amplitude(const sampler *s, double kappa)
{
    double k = fmin(kappa * s->setup.field->extent, s->setup.params.kappa_max);
    return s->setup.params.gamma + 1 / (pow(k, s->setup.params.d) + s->setup.params.nu);
}

bool sampler_is_on_target(const sampler *s, double energy)
{
    return fabs(energy / s->setup.params.energy->ideal - 1) < s->setup.params.energy_tolerance;
}

static void amplitude_chunk(void *context, int worker, size_t begin, size_t end)
{
    sampler *s = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        field_sample sample;
        double kappa1, kappa2;
        if (field_sample_at(s->setup.field, s->state.p->position[i], FIELD_HESSIAN, &sample))
            s->state.p->alpha[i] = sampler_amplitude(s, field_curvature(&sample, &kappa1, &kappa2));
    }
}

/* Amplitudes follow the particles at ever longer intervals: every sweep at first, when they move far, and
 * then after a quarter more sweeps each time. In between the energy is a function of positions alone, which
 * can only fall. */
static bool amplitudes_are_due(const sampler *s)
{
    return s->setup.params.graded && s->record.sweep_count >= s->state.next_amplitudes;
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
    double over_h = 1 / packing_spacing(s->setup.scan->area, (double)s->setup.params.count), squares = 0,
           spacing[SIZE_BATCH];
    (void)worker;
    for (size_t first = begin; first < end; first += SIZE_BATCH) {
        size_t count = end - first < SIZE_BATCH ? end - first : SIZE_BATCH;
        sizing_field_spacings(s->setup.params.sizing, count, s->state.p->position + first, spacing);
        for (size_t k = 0; k < count; k++) {
            double *size = &s->state.p->size[first + k], change = *size / (spacing[k] * over_h) - 1;
            squares += change * change;
            *size = spacing[k] * over_h;
        }
    }
    job->squares[begin / job->grain] = squares;
}

double sampler_resize(sampler *s)
{
    if (!s->setup.params.sizing) return 0;
    size_job job = {s, s->state.p->count / SIZE_PARTS + 1, {0}};
    double squares = 0;
    threads_run(s->setup.pool, s->state.p->count, job.grain, size_chunk, &job);
    for (int k = 0; k < SIZE_PARTS; k++) squares += job.squares[k];
    return sqrt(squares / (double)s->state.p->count);
}

bool sampler_build_lists(sampler *s, error *e)
{
    if (amplitudes_are_due(s)) {
        threads_run(s->setup.pool, s->state.p->count, 256, amplitude_chunk, s);
        s->state.next_amplitudes = s->record.sweep_count + 1 + s->record.sweep_count / 4;
    }
    sampler_resize(s);
    particles_mark_boundary(s->state.p, s->setup.field, s->state.spacing);
    if (!relax_build(s->scratch.relax, s->state.p, s->state.sigma, s->state.skin, e)) return false;
    s->state.lists_stale = false;
    s->state.list_age = 0;
    return true;
}

/* The scales of the level at hand. */
static void enter_level(sampler *s, double support)
{
    s->state.spacing = packing_spacing(s->setup.scan->area, (double)s->state.p->count);
    s->state.sigma = support * s->state.spacing;
    s->state.skin = s->setup.schedule->skin_wide * s->state.spacing;
    s->state.gain = s->setup.schedule->gain[s->state.stage];
}

/* Into an order in which neighbours are near each other in memory too. */
static bool arrange(sampler *s, error *e)
{
    uint32_t *order = mem_array(s->state.p->count, sizeof *order, "the order of particles", e);
    bool ok = order && morton_order(s->state.p->position, s->state.p->count, order, e) &&
              particles_arrange(s->state.p, order, e);
    free(order);
    return ok;
}

static bool is_given(const sampler *s)
{
    return s->setup.params.start == SAMPLER_START_GIVEN;
}

/* Places the particles, in an order for sweeps. */
static bool place(sampler *s, error *e)
{
    size_t removed;
    if (is_given(s)) {
        memcpy(s->state.p->position, s->setup.params.given, s->state.p->count * sizeof *s->state.p->position);
        memcpy(s->state.p->normal, s->setup.params.given_normal,
               s->state.p->count * sizeof *s->state.p->normal);
        return true;
    }
    if (!start_place(s->setup.field, s->setup.scan, &s->setup.params, s->state.spacing, s->setup.pool,
                     s->state.p, &removed, e))
        return false;
    s->record.removed += removed;
    return arrange(s, e);
}

/* Particles on the coarsest level, where they start. */
static bool begin(sampler *s, double support, error *e)
{
    s->state.p->count = s->state.level_count[0];
    enter_level(s, support);
    if (s->setup.params.max_sigma > 0) s->state.sigma = fmin(s->state.sigma, s->setup.params.max_sigma);
    if (!place(s, e)) return false;
    for (size_t i = 0; i < s->state.p->count; i++) s->state.p->lambda[i] = 0;
    return s->setup.method->begin(s, e);
}

sampler *sampler_new(const field *f, const surface *scan, const sampler_params *params, threads *pool,
                     error *e)
{
    sampler *s = mem_alloc(sizeof *s);
    s->setup.field = f;
    s->setup.scan = scan;
    s->setup.params = *params;
    s->setup.method = params->witkin_heckbert ? &sampler_witkin_heckbert : &sampler_meyer;
    if (!params->energy) s->setup.params.energy = &energy_cotangent;
    bool plain = params->coarse_to_fine && s->setup.params.energy == &energy_cotangent && !params->graded &&
                 !params->gradient;
    s->setup.fast = plain ? fast_kernel_for(params->isa) : NULL;
    s->setup.schedule = !plain ? &schedule_paper : is_given(s) ? &schedule_continued : &schedule_multilevel;
    s->setup.pool = pool;
    s->record.sweep =
        mem_array((size_t)params->max_sweeps, sizeof *s->record.sweep, "the record of sweeps", e);
    s->state.p = particles_new(params->count, e);
    s->scratch.relax =
        relax_new(params->count, s->setup.params.energy, s->setup.fast, params->list_limit, pool, e);
    if (!s->record.sweep || !s->state.p || !s->scratch.relax) goto fail;
    s->scratch.capacity = params->count;
    s->state.level_count[0] = params->count;
    s->state.stage = is_given(s) ? SCHEDULE_STAGES - 1 : 0;
    s->state.levels =
        params->coarse_to_fine && !is_given(s)
            ? levels_plan(f, scan, params->sizing, params->count, params->seed, s->state.level_count)
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
    s->setup.method->release(s);
    particles_free(s->state.p);
    relax_free(s->scratch.relax);
    free(s->record.sweep);
    free(s->record.replaced);
    free(s->record.column);
    free(s);
}

static size_t count_on_boundary(const sampler *s)
{
    size_t count = 0;
    for (size_t i = 0; i < s->state.p->count; i++)
        count += projection_boundary_axes(s->setup.field, s->state.p->position[i]) != 0;
    return count;
}

/* When the coarsest level does not see the surface for its edges the next finer one takes its place. */
static bool drop_coarsest(sampler *s, bool *again, error *e)
{
    *again = relax_creased_share(s->scratch.relax, s->state.p) > s->setup.schedule->creased_share;
    if (!*again) return true;
    s->state.levels--;
    memmove(s->state.level_count, s->state.level_count + 1,
            (size_t)s->state.levels * sizeof *s->state.level_count);
    return begin(s, s->state.sigma / s->state.spacing, e);
}

/* Begins again with a better count once: the boundaries fill up only with time, so the last word is left to the
 * levels between. */
bool sampler_replan(sampler *s, bool *again, error *e)
{
    size_t count = s->state.p->count, edges;
    if (s->state.stage == 0) return drop_coarsest(s, again, e);
    if (!refine_count_edges(s->state.p, s->state.spacing, s->setup.pool, &edges, e)) return false;
    levels_correct(s->state.level_count, s->state.levels, edges, count_on_boundary(s));
    *again = !s->state.planned && s->state.level_count[0] != count;
    s->state.planned = true;
    if (*again) return begin(s, s->state.sigma / s->state.spacing, e);
    s->state.level_count[0] = count;
    return true;
}

/* A level has come to rest: four times as many particles, with the support that it needed. */
bool sampler_refine(sampler *s, error *e)
{
    assert(s->state.level + 1 < s->state.levels);
    double support = s->state.sigma / s->state.spacing;
    if (!refine_particles(s->setup.field, s->setup.scan, s->setup.params.sizing, s->state.p,
                          s->state.level_count[++s->state.level], s->state.spacing, s->setup.params.seed,
                          s->setup.pool, e) ||
        !arrange(s, e))
        return false;
    enter_level(s, support);
    for (size_t i = 0; i < s->state.p->count; i++) s->state.p->lambda[i] = 0;
    return sampler_build_lists(s, e);
}

/* The share of a solve that a refined level of so many particles stands for: levels count by their particles, but for
 * the coarsest, which takes more sweeps. */
static double share_of(const sampler *s, size_t count)
{
    return FINE_BEGINS + (1 - FINE_BEGINS) * (double)count / (double)s->setup.params.count;
}

static void estimate_fraction(sampler *s, const schedule_evidence *seen)
{
    double low = 0, high = 1;
    if (s->state.levels > 1) {
        low = s->state.level == 0 ? 0 : share_of(s, s->state.level_count[s->state.level - 1]);
        high = s->state.level == 0 ? FINE_BEGINS : share_of(s, s->state.level_count[s->state.level]);
    }
    const schedule_position at = position(s);
    s->state.fraction =
        fmax(s->state.fraction, low + (high - low) * schedule_level_progress(s->setup.schedule, &at, seen));
}

/* At rest under sizes of a while ago, most of all: with those of now there may be more to do, unless the next
 * level does it. */
static bool sizes_are_settled(sampler *s)
{
    if (s->state.level > 0 && s->state.level < s->state.levels - 1) return true;
    if (sampler_resize(s) < s->setup.schedule->size_settled ||
        s->state.resizes == s->setup.schedule->resizes_most)
        return true;
    s->state.resizes++;
    s->state.lists_stale = true;
    for (size_t i = 0; i < s->state.p->count; i++) s->state.p->lambda[i] = 0;
    return false;
}

/* A line of the record. */
static void note_sweep(sampler *s, const relax_sums *sums)
{
    double alpha = 0;
    for (size_t i = 0; i < s->state.p->count; i++) alpha += s->state.p->alpha[i];
    alpha /= (double)s->state.p->count;
    s->record.sweep[s->record.sweep_count++] = (sampler_sweep){.energy = sums->energy / alpha,
                                                               .mean_log10_lambda = sums->mean_log10_lambda,
                                                               .rms_step = sums->rms_step,
                                                               .count = s->state.p->count,
                                                               .sigma = s->state.sigma,
                                                               .rejected = sums->rejected};
}

static bool relax_step(sampler *s, error *e)
{
    if (s->state.lists_stale && !sampler_build_lists(s, e)) return false;
    schedule_position at = position(s);
    const relax_params params = {.field = s->setup.field,
                                 .minimiser =
                                     s->setup.params.gradient ? RELAX_GRADIENT : RELAX_LEVENBERG_MARQUARDT,
                                 .step = s->setup.params.step,
                                 .sigma = s->state.sigma,
                                 .spacing = s->state.spacing,
                                 .omega = schedule_omega(s->setup.schedule, &at),
                                 .fast_step = schedule_longest_step(s->setup.schedule, &at),
                                 .gain = s->state.gain};
    relax_sums sums;
    relax_sweep(s->scratch.relax, s->state.p, &params, &sums);
    at.sweeps = ++s->state.sweeps_in_round;
    note_sweep(s, &sums);
    const schedule_evidence seen = {sums.rms_step, sums.mean_log10_lambda, !s->setup.params.gradient,
                                    s->setup.params.step_tolerance};
    estimate_fraction(s, &seen);
    if (schedule_is_impatient(s->setup.schedule, &at)) s->state.gain *= 10;
    s->state.lists_stale = schedule_wants_lists(s->setup.schedule, &at, sums.cramped, ++s->state.list_age) ||
                           amplitudes_are_due(s);
    s->state.skin = schedule_skin(s->setup.schedule, sums.rms_step) * s->state.spacing;
    if (schedule_is_at_rest(s->setup.schedule, &at, &seen) && sizes_are_settled(s) && !sampler_control(s, e))
        return false;
    if (s->state.outcome == SAMPLER_RUNNING && s->record.sweep_count == (size_t)s->setup.params.max_sweeps)
        s->state.outcome = SAMPLER_OUT_OF_SWEEPS;
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
    assert(!sampler_ended(s) && s->record.sweep_count < (size_t)s->setup.params.max_sweeps);
    return s->setup.method->step(s, e);
}

bool sampler_ended(const sampler *s)
{
    return s->state.outcome != SAMPLER_RUNNING;
}

sampler_outcome sampler_result(const sampler *s)
{
    return s->state.outcome;
}

const sampler_sweep *sampler_sweeps(const sampler *s, size_t *count)
{
    *count = s->record.sweep_count;
    return s->record.sweep;
}

const sampler_round *sampler_rounds(const sampler *s, size_t *count)
{
    *count = s->record.round_count;
    return s->record.round;
}

double sampler_fraction(const sampler *s)
{
    return s->state.fraction;
}

double sampler_excess(const sampler *s, const sampler_sweep *sweep)
{
    return sweep->energy / s->setup.params.energy->ideal - 1;
}

double sampler_spacing(const sampler *s)
{
    return s->state.spacing;
}

size_t sampler_removed_offsurface(const sampler *s)
{
    return s->record.removed;
}
