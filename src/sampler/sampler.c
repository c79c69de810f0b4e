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

/* The paper's criterion for a system at rest (section 7, step 2). */
static const double REST_LAMBDA = 14;
/* Over-relaxation of the step, which the first-term Hessian makes about half of Newton's: 1.8 needs three
 * times the sweeps, 3.0 is slower again near rest. */
static const double OMEGA = 2.6;

/* Share of the sweeps that a job typically spends before each round, for the estimate of progress. */
static const double round_share[SAMPLER_STAGES + 1] = {0, 0.07, 0.35, 1};
/* And where refined levels begin. */
static const double FINE_BEGINS = 0.4;

/* On surfaces with features below h some particles creep for ever, each sweep gaining a little more than
 * that. A round that is longer than this many sweeps asks for ten times the gain, and again after each so
 * many. */
static const int round_patience[SAMPLER_STAGES] = {80, 150, 400}, PATIENCE_MORE = 50;
/* Lists are built anew when more than this share of the particles cannot move as they would, a larger one on
 * levels that are refined again, and for any one after so many sweeps. */
static const double CRAMPED_SHARE = 0.01, CRAMPED_SHARE_COARSE = 0.04;
static const int CRAMPED_WAIT = 4, CRAMPED_WAIT_FAST = 12; /* where sweeps cost less than lists */
/* What the lists reach beyond the support, of h: SAMPLER_SKIN_WIDE while particles move far, narrow when a
 * few sweeps of their steps are less. */
static const double SKIN_NARROW = 0.2, SKIN_STEPS = 6;

/* A rest holds when sizes, as of the particles' places, have changed by less than this in the root mean
 * square since the lists were built; so many times in a round it may be broken. */
static const double SIZE_SETTLED = 1e-3;
static const int RESIZES_MAX = 10;

/* A coarsest level of which more particles than this see round edges or through sheets is too coarse. */
static const double CREASED_SHARE = 0.5;

/* A level that is to be refined is left when the rms step is below this (of h), or after so many sweeps. */
static const double LEVEL_STEP = 5e-3;
static const int LEVEL_SWEEPS = 30;

/* Sweeps of a level by its count: coarse levels cost little, and what is out of order on them stays so.
 * Twice as many on all levels bring edge_cv at 100 000 points from .041 to .039 and cost half as much
 * again. */
static const double LEVEL_SWEEPS_MANY = 100, LEVEL_MANY = 1e4, LEVEL_MANY_BETWEEN = 5e3, LEVEL_FALL = 1.5;
static const double LEVEL_SWEEPS_LEAST = 4, LEVEL_SWEEPS_MOST = 120;
/* A stage of the coarsest level that creeps is left after so many sweeps; its first ones even out a start,
 * for which so many are enough before steps are watched. */
static const int STAGE_SWEEPS_MOST = 400, STAGE_SHAKEN = 15;
/* Ten times the rms step of a shaken level: what is longer belongs to a particle that finds no rest. */
static const double FAST_STEP_LONGEST = 0.05;
/* Over-relaxation, of the first-term Hessian: with 3.0 and more a refined level loses its order. Sizes that
 * vary make stiffer neighbours: with 2.7 such a level would swing by a tenth of h for thirty sweeps. */
static const double OMEGA_SHAKE = 2.7, OMEGA_SHAKE_GRADED = 2.4, OMEGA_SETTLE = 2.2, OMEGA_LEAST = 1.2;

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
    s->skin = SAMPLER_SKIN_WIDE * s->spacing;
    s->gain = sampler_stage_gain[s->stage];
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
    s->pool = pool;
    s->sweep = mem_array((size_t)params->max_sweeps, sizeof *s->sweep, "the record of sweeps", e);
    s->p = particles_new(params->count, e);
    s->relax = relax_new(params->count, s->params.energy, s->fast, params->list_limit, pool, e);
    if (!s->sweep || !s->p || !s->relax) goto fail;
    s->capacity = params->count;
    s->level_count[0] = params->count;
    s->stage = is_given(s) ? SAMPLER_STAGES - 1 : 0;
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
    *again = relax_creased_share(s->relax, s->p) > CREASED_SHARE;
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

/* Sweeps that a level has at least, by its count. */
static int level_sweeps(const sampler *s)
{
    bool between = s->level > 0 && s->level < s->levels - 1;
    double many = between ? LEVEL_MANY_BETWEEN : LEVEL_MANY;
    double sweeps = LEVEL_SWEEPS_MANY * pow(many / (double)s->p->count, LEVEL_FALL);
    return (int)fmin(fmax(sweeps, LEVEL_SWEEPS_LEAST), LEVEL_SWEEPS_MOST);
}

/* Over-relaxation of sweeps that nothing watches: long steps shake a level's dislocations together first,
 * shorter ones settle it; where it does not come to rest for long they become shorter still. */
static double fast_omega(const sampler *s)
{
    if (is_given(s)) return OMEGA_LEAST;
    if (s->level == 0 && s->stage < SAMPLER_STAGES - 1) return OMEGA_SETTLE;
    double t = (double)s->sweeps_in_round / level_sweeps(s);
    double shake = s->params.sizing ? OMEGA_SHAKE_GRADED : OMEGA_SHAKE;
    if (t < 1) return shake + (OMEGA_SETTLE - shake) * t * t;
    return fmax(OMEGA_SETTLE / t, OMEGA_LEAST);
}

/* Over h: round edges and through sheets single particles would leap to and fro for ever, but once the
 * level has been shaken, long steps are watched, and with time all are. */
static double longest_fast_step(const sampler *s)
{
    if (is_given(s)) return FAST_STEP_LONGEST;
    bool first_stages = s->level == 0 && s->stage < SAMPLER_STAGES - 1;
    double t = s->sweeps_in_round / (double)(first_stages ? STAGE_SHAKEN : level_sweeps(s));
    return t < 1 ? INFINITY : FAST_STEP_LONGEST / (t * t);
}

/* A level has its sweeps; the coarsest, which sets the order of all, comes to rest stage by stage, and the
 * last to what was asked for. */
static bool fast_steps_are_at_rest(const sampler *s, const relax_sums *sums)
{
    static const double stage_step[SAMPLER_STAGES] = {0.03, 0.01, 0.001};
    bool last_stage = s->stage == SAMPLER_STAGES - 1, last_level = s->level == s->levels - 1;
    if (last_stage && s->sweeps_in_round < level_sweeps(s) && !is_given(s)) return false;
    if (last_level && last_stage) return sums->rms_step < s->params.step_tolerance;
    return s->level > 0 || sums->rms_step < stage_step[s->stage] || s->sweeps_in_round >= STAGE_SWEEPS_MOST;
}

/* The paper's steady state; a refined level starts near its own and is judged by its steps, and one that is
 * to be refined again need not wait for the last of them. */
static bool is_at_rest(const sampler *s, const relax_sums *sums)
{
    if (s->fast) return fast_steps_are_at_rest(s, sums);
    bool last_stage = s->stage == SAMPLER_STAGES - 1, last_level = s->level == s->levels - 1;
    if (s->level > 0 && !last_level) return sums->rms_step < LEVEL_STEP || s->sweeps_in_round >= LEVEL_SWEEPS;
    bool still = sums->rms_step < s->params.step_tolerance;
    if (s->level > 0 || s->params.gradient) return still; /* there is no lambda to go by */
    return sums->mean_log10_lambda > REST_LAMBDA && (!last_stage || still);
}

/* Lambda climbs from its floor to its cap within a round, and the step falls to its tolerance on a refined
 * level. Levels count by their particles, but for the coarsest, which takes more sweeps. */
static void estimate_fraction(sampler *s, const relax_sums *sums)
{
    double low = 0, high = 1;
    if (s->levels > 1) {
        low = s->level == 0 ? 0
                            : FINE_BEGINS + (1 - FINE_BEGINS) * (double)s->level_count[s->level - 1] /
                                                (double)s->params.count;
        high = s->level == 0 ? FINE_BEGINS
                             : FINE_BEGINS + (1 - FINE_BEGINS) * (double)s->level_count[s->level] /
                                                 (double)s->params.count;
    }
    double climb;
    if (s->fast) {
        climb = fmin((double)s->sweeps_in_round / level_sweeps(s), 1);
        if (s->level == 0)
            climb = round_share[s->stage] + (round_share[s->stage + 1] - round_share[s->stage]) * climb;
    } else if (s->level == 0) {
        climb = fmin(fmax((sums->mean_log10_lambda + 3) / (REST_LAMBDA + 3), 0), 1);
        climb = round_share[s->stage] + (round_share[s->stage + 1] - round_share[s->stage]) * climb;
    } else
        climb = fmin(1, s->params.step_tolerance / fmax(sums->rms_step, 1e-300));
    s->fraction = fmax(s->fraction, low + (high - low) * climb);
}

/* At rest under sizes of a while ago, most of all: with those of now there may be more to do, unless the next
 * level does it. */
static bool sizes_are_settled(sampler *s)
{
    if (s->level > 0 && s->level < s->levels - 1) return true;
    if (sampler_resize(s) < SIZE_SETTLED || s->resizes == RESIZES_MAX) return true;
    s->resizes++;
    s->lists_stale = true;
    for (size_t i = 0; i < s->p->count; i++) s->p->lambda[i] = 0;
    return false;
}

static bool relax_step(sampler *s, error *e)
{
    if (s->lists_stale && !sampler_build_lists(s, e)) return false;
    relax_params params = {.field = s->field,
                           .minimiser = s->params.gradient ? RELAX_GRADIENT : RELAX_LEVENBERG_MARQUARDT,
                           .step = s->params.step,
                           .sigma = s->sigma,
                           .spacing = s->spacing,
                           .omega = s->fast ? fast_omega(s) : OMEGA,
                           .fast_step = longest_fast_step(s),
                           .gain = s->gain};
    relax_sums sums;
    relax_sweep(s->relax, s->p, &params, &sums);
    s->sweeps_in_round++;
    double alpha = 0;
    for (size_t i = 0; i < s->p->count; i++) alpha += s->p->alpha[i];
    alpha /= (double)s->p->count;
    s->sweep[s->sweep_count++] = (sampler_sweep){sums.energy / alpha,
                                                 sums.mean_log10_lambda,
                                                 sums.rms_step,
                                                 s->p->count,
                                                 s->sigma,
                                                 sums.rejected,
                                                 0,
                                                 0};
    estimate_fraction(s, &sums);
    int over = s->sweeps_in_round - round_patience[s->stage];
    if (over >= 0 && over % PATIENCE_MORE == 0) s->gain *= 10;
    s->list_age++;
    double cramped_share = s->level < s->levels - 1 ? CRAMPED_SHARE_COARSE : CRAMPED_SHARE;
    s->lists_stale = (double)sums.cramped > cramped_share * (double)s->p->count || amplitudes_are_due(s) ||
                     (sums.cramped > 0 && s->list_age >= (s->fast ? CRAMPED_WAIT_FAST : CRAMPED_WAIT));
    s->skin = fmin(SAMPLER_SKIN_WIDE, fmax(SKIN_NARROW, SKIN_STEPS * sums.rms_step)) * s->spacing;
    if (is_at_rest(s, &sums) && sizes_are_settled(s) && !sampler_control(s, e)) return false;
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
