#include "sampler/sampler.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "sampler/energy.h"
#include "sampler/particles.h"
#include "sampler/project.h"
#include "sampler/refine.h"
#include "sampler/relax.h"
#include "sampler/start.h"

/* The paper's criterion for a system at rest (section 7, step 2). */
static const double REST_LAMBDA = 14;
static const double ALPHA_EXPONENT = 0.18;
/* Over-relaxation of the step, which the first-term Hessian makes about half of Newton's: 1.8 needs three
 * times the sweeps, 3.0 is slower again near rest. */
static const double OMEGA = 2.6;

/* A round relaxes until no particle can lower its energy by more than this fraction; each later one
 * looks closer. The first evens out the density, so that sigma is adapted before much work is done
 * under a wrong one. */
static const double round_gain[] = {1e-4, 1e-6, 1e-8};
enum { ROUNDS = sizeof round_gain / sizeof round_gain[0] };
/* Share of the sweeps that a job typically spends before each round, for the estimate of progress. */
static const double round_share[ROUNDS + 1] = {0, 0.07, 0.35, 1};
/* And where refined levels begin. */
static const double FINE_BEGINS = 0.4;

/* On surfaces with features below h some particles creep for ever, each sweep gaining a little more than that.
 * A round that is longer than this many sweeps asks for ten times the gain, and again after each so many. */
static const int round_patience[ROUNDS] = {80, 150, 400}, PATIENCE_MORE = 50;
/* Lists are built anew when more than this share of the particles cannot move as they would, and for any one
 * after so many sweeps. */
static const double CRAMPED_SHARE = 0.01;
static const int CRAMPED_WAIT = 4;
/* A finished particle is on the surface to this fraction of h, or it is replaced. */
static const double WORST_RESIDUAL = 1e-6;
static const int REPLACEMENT_DRAWS = 30;
static const int SETTLE_STEPS = 20;
static const double SETTLE_FARTHEST = 0.05;
enum { MAX_ROUNDS = 24 };
/* What the lists reach beyond the support, of h: wide while particles move far, narrow when a few sweeps of
 * their steps are less. */
static const double SKIN_WIDE = 0.6, SKIN_NARROW = 0.2, SKIN_STEPS = 6;
/* The search for the ideal support: within one set of lists it may shrink to this fraction and grow by the
 * other; so many Newton steps settle it to the tolerance, so many sets of lists reach it from anywhere. */
static const double SHRINK_LIMIT = 0.2, SUPPORT_GROWTH = 0.5, SUPPORT_TOLERANCE = 1e-6;
enum { SUPPORT_STEPS = 6, SUPPORT_BUILDS = 24 };
/* A system that rests only under a coarser gain than this is not converged. */
static const double COARSEST_GAIN = 1e-5;

/* Coarse to fine: the coarsest packing sets the order of the finest, at a cost that does not show, unless its
 * spacing is coarser than this fraction of the radius of curvature, where strain is locked in. */
static const double COARSEST_BEND = 1.0 / 2;
enum { MAX_LEVELS = 12, FEWEST_PARTICLES = 100, BEND_SAMPLES = 400 };
/* Of the curvatures of those samples, the one that counts. */
static const double BEND_QUANTILE = 0.9;
/* A level that is to be refined is left when the rms step is below this (of h), or after so many sweeps. */
static const double LEVEL_STEP = 5e-3;
static const int LEVEL_SWEEPS = 30;

struct sampler {
    const field *field;
    const surface *scan;
    sampler_params params;
    threads *pool;
    particles *p;
    relax *relax;
    double spacing; /* h */
    double sigma;
    double skin;
    size_t level_count[MAX_LEVELS]; /* particles of each level; the last is params.count */
    int level, levels;
    int stage;   /* of round_gain */
    double gain; /* in force: that of the stage, or more when it does not come to rest */
    bool lists_stale;
    int list_age;           /* sweeps since they were built */
    size_t next_amplitudes; /* the sweep before which they are renewed */
    sampler_outcome outcome;
    size_t removed;
    sampler_sweep *sweep;
    size_t sweep_count;
    sampler_round round[MAX_ROUNDS];
    size_t round_count;
    int sweeps_in_round;
    double fraction;
    sampler_points out;
    double *column; /* kappa, kappa1, kappa2, spacing: one after the other */
};

/* (14), with curvature freed of scale by L and bounded. */
static double amplitude(const sampler *s, double kappa)
{
    double k = fmin(kappa * s->field->extent, s->params.kappa_max);
    return s->params.gamma + 1 / (pow(k, s->params.d) + s->params.nu);
}

static void amplitude_chunk(void *context, int worker, size_t begin, size_t end)
{
    sampler *s = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        field_sample sample;
        double kappa1, kappa2;
        if (field_sample_at(s->field, s->p->position[i], FIELD_HESSIAN, &sample))
            s->p->alpha[i] = amplitude(s, field_curvature(&sample, &kappa1, &kappa2));
    }
}

/* Amplitudes follow the particles at ever longer intervals: every sweep at first, when they move far, and
 * then after a quarter more sweeps each time. In between the energy is a function of positions alone, which
 * can only fall. */
static bool amplitudes_are_due(const sampler *s)
{
    return s->params.graded && s->sweep_count >= s->next_amplitudes;
}

static void mark_rims(sampler *s)
{
    if (!s->field->open) return;
    vec3 margin = vec3_scale((vec3){1, 1, 1}, 2 * s->spacing);
    bbox inner = {vec3_add(s->field->domain.min, margin), vec3_sub(s->field->domain.max, margin)};
    for (size_t i = 0; i < s->p->count; i++) s->p->rim[i] = !bbox_contains(inner, s->p->position[i]);
}

static bool build_lists(sampler *s, error *e)
{
    if (amplitudes_are_due(s)) {
        threads_run(s->pool, s->p->count, 256, amplitude_chunk, s);
        s->next_amplitudes = s->sweep_count + 1 + s->sweep_count / 4;
    }
    mark_rims(s);
    if (!relax_build(s->relax, s->p, s->sigma, s->skin, e)) return false;
    s->lists_stale = false;
    s->list_age = 0;
    return true;
}

static int compare_double(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The larger principal curvature that a tenth of the surface exceeds. */
static double typical_bend(const sampler *s)
{
    rng r = rng_seed(s->params.seed, 4);
    double bend[BEND_SAMPLES];
    size_t found = 0;
    for (int k = 0; k < BEND_SAMPLES; k++) {
        field_sample sample;
        double kappa1, kappa2;
        vec3 x = surface_point(s->scan, (k + 0.5) / BEND_SAMPLES * s->scan->area, &r);
        if (!field_sample_at(s->field, x, FIELD_HESSIAN, &sample)) continue;
        field_curvature(&sample, &kappa1, &kappa2);
        bend[found++] = fmax(fabs(kappa1), fabs(kappa2));
    }
    if (found == 0) return INFINITY;
    qsort(bend, found, sizeof *bend, compare_double);
    return bend[(size_t)(BEND_QUANTILE * (double)(found - 1))];
}

static double even_spacing(const sampler *s, size_t count)
{
    return sqrt(2 * s->scan->area / (sqrt(3) * (double)count));
}

static void plan_levels(sampler *s)
{
    size_t count[MAX_LEVELS] = {s->params.count};
    s->levels = 1;
    double coarsest = s->params.coarse_to_fine ? COARSEST_BEND / typical_bend(s) : 0;
    while (s->levels < MAX_LEVELS) {
        size_t next = refine_coarser(count[s->levels - 1]);
        if (next < FEWEST_PARTICLES || even_spacing(s, next) > coarsest) break;
        count[s->levels++] = next;
    }
    for (int k = 0; k < s->levels; k++) s->level_count[k] = count[s->levels - 1 - k];
}

/* The scales of the level at hand. */
static void enter_level(sampler *s, double support)
{
    s->spacing = even_spacing(s, s->p->count);
    s->sigma = support * s->spacing;
    s->skin = SKIN_WIDE * s->spacing;
    s->gain = round_gain[s->stage];
}

sampler *sampler_new(const field *f, const surface *scan, const sampler_params *params, threads *pool,
                     error *e)
{
    sampler *s = mem_alloc(sizeof *s);
    s->field = f;
    s->scan = scan;
    s->params = *params;
    if (!params->energy) s->params.energy = &energy_cotangent;
    s->pool = pool;
    s->sweep = mem_array((size_t)params->max_sweeps, sizeof *s->sweep, "the record of sweeps", e);
    s->p = particles_new(params->count, e);
    s->relax = relax_new(params->count, s->params.energy, params->list_limit, pool, e);
    if (!s->sweep || !s->p || !s->relax) goto fail;
    plan_levels(s);
    s->p->count = s->level_count[0];
    /* a support that is given is meant for the whole count */
    enter_level(s, params->sigma > 0 ? params->sigma / even_spacing(s, params->count) : sqrt(3));
    if (!start_place(f, scan, params, s->spacing, pool, s->p, &s->removed, e) || !build_lists(s, e))
        goto fail;
    return s;
fail:
    sampler_free(s);
    return NULL;
}

void sampler_free(sampler *s)
{
    if (!s) return;
    particles_free(s->p);
    relax_free(s->relax);
    free(s->sweep);
    free(s->column);
    free(s);
}

/* The support under which the particles, where they are, have the ideal energy: Newton's method on log E
 * against log sigma (6.1: a one-dimensional optimisation), no farther than the lists cover. */
static double ideal_support(const sampler *s)
{
    double low = SHRINK_LIMIT * s->sigma, high = relax_max_support(s->relax), sigma = s->sigma;
    for (int k = 0; k < SUPPORT_STEPS; k++) {
        double energy = relax_mean_energy(s->relax, s->p, sigma);
        if (!(energy > 0)) return high;
        double ratio = energy / s->params.energy->ideal;
        if (fabs(ratio - 1) < SUPPORT_TOLERANCE) break;
        sigma *= pow(ratio, -1 / s->params.energy->ideal_slope);
        sigma = fmin(fmax(sigma, low), high);
    }
    return sigma;
}

/* Grows or shrinks sigma to its ideal, with new lists as often as it leaves the old ones' range. */
static bool adapt_support(sampler *s, error *e)
{
    for (int k = 0; k < SUPPORT_BUILDS; k++) {
        double before = s->sigma;
        s->skin = fmax(SKIN_WIDE * s->spacing, SUPPORT_GROWTH * s->sigma);
        if (!build_lists(s, e)) return false;
        s->sigma = fmin(ideal_support(s), bbox_longest(s->scan->box) * 2);
        bool at_bound = s->sigma >= (1 - SUPPORT_TOLERANCE) * relax_max_support(s->relax) ||
                        s->sigma <= (1 + SUPPORT_TOLERANCE) * SHRINK_LIMIT * before;
        if (!at_bound) break;
    }
    s->skin = SKIN_WIDE * s->spacing;
    return build_lists(s, e);
}

static void note_round(sampler *s, double energy)
{
    s->round[s->round_count++] =
        (sampler_round){s->sweeps_in_round, 0, 0, s->sigma, s->p->count, energy, s->gain};
    s->sweeps_in_round = 0;
}

/* A level has come to rest: four times as many particles, with the support that it needed. */
static bool refine(sampler *s, error *e)
{
    double support = s->sigma / s->spacing;
    if (!refine_particles(s->field, s->scan, s->p, s->level_count[++s->level], s->spacing, s->params.seed,
                          s->pool, e))
        return false;
    enter_level(s, support);
    for (size_t i = 0; i < s->p->count; i++) s->p->lambda[i] = 0;
    return build_lists(s, e);
}

static bool is_on_target(const sampler *s, double energy)
{
    return fabs(energy / s->params.energy->ideal - 1) < s->params.energy_tolerance;
}

/* A round has come to rest: adapt the support and look closer, refine, or end. */
static bool control(sampler *s, error *e)
{
    double energy = relax_mean_energy(s->relax, s->p, s->sigma);
    note_round(s, energy);
    bool last_stage = s->stage == ROUNDS - 1;
    if (last_stage && s->level < s->levels - 1) return refine(s, e);
    bool on_target = is_on_target(s, energy);
    if (last_stage && (on_target || s->round_count == MAX_ROUNDS)) {
        s->outcome = on_target && s->gain <= COARSEST_GAIN ? SAMPLER_CONVERGED : SAMPLER_STALLED;
        return true;
    }
    if (!last_stage) s->stage++;
    s->gain = round_gain[s->stage];
    for (size_t i = 0; i < s->p->count; i++) s->p->lambda[i] = 0;
    return adapt_support(s, e);
}

/* The paper's steady state; a refined level starts near its own and is judged by its steps, and one that is
 * to be refined again need not wait for the last of them. */
static bool is_at_rest(const sampler *s, const relax_sums *sums)
{
    bool last_stage = s->stage == ROUNDS - 1, last_level = s->level == s->levels - 1;
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
    if (s->level == 0) {
        climb = fmin(fmax((sums->mean_log10_lambda + 3) / (REST_LAMBDA + 3), 0), 1);
        climb = round_share[s->stage] + (round_share[s->stage + 1] - round_share[s->stage]) * climb;
    } else
        climb = fmin(1, s->params.step_tolerance / fmax(sums->rms_step, 1e-300));
    s->fraction = fmax(s->fraction, low + (high - low) * climb);
}

bool sampler_step(sampler *s, error *e)
{
    if (s->lists_stale && !build_lists(s, e)) return false;
    relax_params params = {.field = s->field,
                           .minimiser = s->params.gradient ? RELAX_GRADIENT : RELAX_LEVENBERG_MARQUARDT,
                           .step = s->params.step,
                           .sigma = s->sigma,
                           .spacing = s->spacing,
                           .omega = OMEGA,
                           .gain = s->gain};
    relax_sums sums;
    relax_sweep(s->relax, s->p, &params, &sums);
    s->sweeps_in_round++;
    double alpha = 0;
    for (size_t i = 0; i < s->p->count; i++) alpha += s->p->alpha[i];
    alpha /= (double)s->p->count;
    s->sweep[s->sweep_count++] = (sampler_sweep){
        sums.energy / alpha, sums.mean_log10_lambda, sums.rms_step, s->p->count, s->sigma, sums.rejected};
    estimate_fraction(s, &sums);
    int over = s->sweeps_in_round - round_patience[s->stage];
    if (over >= 0 && over % PATIENCE_MORE == 0) s->gain *= 10;
    s->list_age++;
    s->lists_stale = sums.cramped > CRAMPED_SHARE * (double)s->p->count || amplitudes_are_due(s) ||
                     (sums.cramped > 0 && s->list_age >= CRAMPED_WAIT);
    s->skin = fmin(SKIN_WIDE, fmax(SKIN_NARROW, SKIN_STEPS * sums.rms_step)) * s->spacing;
    if (is_at_rest(s, &sums) && !control(s, e)) return false;
    if (s->outcome == SAMPLER_RUNNING && s->sweep_count == (size_t)s->params.max_sweeps)
        s->outcome = SAMPLER_OUT_OF_SWEEPS;
    return true;
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

/* What (13) makes of an amplitude under a common support: the spacing goes as alpha^0.18 (measured on the
 * quartic: 0.181 with d = 1, 0.171 with d = 3; a mean-field estimate gives the inverse of E_ideal's slope,
 * 0.21). The scale keeps the sum of the ideal cells equal to the area. */
static void requested_spacing(sampler *s, double *spacing)
{
    double squares = 0;
    for (size_t i = 0; i < s->p->count; i++) {
        spacing[i] = s->params.graded ? pow(s->p->alpha[i], ALPHA_EXPONENT) : 1;
        squares += spacing[i] * spacing[i];
    }
    double scale = s->spacing / sqrt(squares / (double)s->p->count);
    for (size_t i = 0; i < s->p->count; i++) spacing[i] *= scale;
}

typedef struct finish_job {
    sampler *s;
    double *residual; /* over h; inf: not on the surface */
} finish_job;

/* To rounding: a Newton step from 1e-7 h leaves less than doubles resolve. A relaxed particle is within 0.01 h
 * of the surface; one that would have to go much farther sits where Newton's method goes astray. */
static bool settle_on_surface(const sampler *s, double farthest, vec3 *x, vec3 *normal)
{
    double h = s->spacing;
    const project_limits limits = {SETTLE_STEPS, 1e-9 * h, 1e-7 * h, WORST_RESIDUAL * h};
    vec3 q = *x, n = *normal;
    if (project_point(s->field, &limits, &q, &n) && vec3_norm(vec3_sub(q, *x)) <= farthest) {
        *x = q;
        *normal = n;
        return true;
    }
    return project_bisect(s->field, *normal, farthest, x, normal);
}

static void finish_particle(const finish_job *job, size_t i)
{
    sampler *s = job->s;
    size_t n = s->p->count;
    vec3 x = s->p->position[i], normal = s->p->normal[i];
    field_sample sample;
    job->residual[i] = INFINITY;
    if (!settle_on_surface(s, SETTLE_FARTHEST * s->spacing, &x, &normal) ||
        !field_sample_at(s->field, x, FIELD_HESSIAN, &sample))
        return;
    double length = vec3_norm(sample.gradient), residual = fabs(sample.value) / length / s->spacing;
    if (!(residual < WORST_RESIDUAL)) return;
    job->residual[i] = residual;
    s->p->position[i] = x;
    s->p->normal[i] = vec3_scale(sample.gradient, 1 / length);
    s->column[i] = field_curvature(&sample, &s->column[n + i], &s->column[2 * n + i]);
    if (s->params.graded) s->p->alpha[i] = amplitude(s, s->column[i]);
}

static void finish_chunk(void *context, int worker, size_t begin, size_t end)
{
    (void)worker;
    for (size_t i = begin; i < end; i++) finish_particle(context, i);
}

/* Takes away the particles that are not on the surface and puts each on a new place there: of several drawn
 * the one that is farthest from its nearest particle. */
static void replace_lost(finish_job *job)
{
    sampler *s = job->s;
    rng r = rng_seed(s->params.seed, 2);
    for (size_t i = 0; i < s->p->count && !threads_stopped(s->pool); i++) {
        if (job->residual[i] != INFINITY) continue;
        double best = -1;
        vec3 x = s->p->position[i], normal = s->p->normal[i];
        for (int draw = 0; draw < REPLACEMENT_DRAWS; draw++) {
            vec3 q = surface_point(s->scan, rng_uniform(&r) * s->scan->area, &r), n = {0, 0, 1};
            if (!settle_on_surface(s, s->field->cell_size, &q, &n)) continue;
            double nearest2 = INFINITY;
            for (size_t j = 0; j < s->p->count; j++)
                if (j != i) nearest2 = fmin(nearest2, vec3_norm2(vec3_sub(q, s->p->position[j])));
            if (nearest2 <= best) continue;
            best = nearest2;
            x = q;
            normal = n;
        }
        if (best < 0) continue;
        s->p->position[i] = x;
        s->p->normal[i] = normal;
        s->removed++;
        finish_particle(job, i);
    }
}

static void describe_result(sampler *s, const double *residual)
{
    size_t n = s->p->count;
    s->out = (sampler_points){
        .count = n,
        .position = s->p->position,
        .normal = s->p->normal,
        .kappa = s->column,
        .kappa1 = s->column + n,
        .kappa2 = s->column + 2 * n,
        .alpha = s->p->alpha,
        .energy = s->p->energy,
        .spacing = s->column + 3 * n,
        .sigma = s->sigma,
        .ideal_energy = s->params.energy->ideal,
    };
    for (size_t i = 0; i < n; i++) {
        if (residual[i] == INFINITY)
            s->out.lost++;
        else
            s->out.max_residual = fmax(s->out.max_residual, residual[i]);
    }
    s->out.mean_energy = relax_mean_energy(s->relax, s->p, s->sigma);
    s->out.mean_neighbours = relax_mean_neighbours(s->relax, s->p, s->sigma);
    requested_spacing(s, s->column + 3 * n);
}

bool sampler_finish(sampler *s, error *e)
{
    while (s->level < s->levels - 1) /* stopped early: the count is exact all the same */
        if (!refine(s, e)) return false;
    size_t n = s->p->count;
    finish_job job = {s, mem_array(n, sizeof *job.residual, "the result", e)};
    bool ok = false;
    if (!s->column) s->column = mem_array(4 * n, sizeof *s->column, "the result", e);
    if (!s->column || !job.residual) goto done;
    threads_run(s->pool, n, 256, finish_chunk, &job);
    replace_lost(&job);
    if (!relax_build(s->relax, s->p, s->sigma, 0, e)) goto done;
    describe_result(s, job.residual);
    if (s->outcome == SAMPLER_CONVERGED && (s->out.lost > 0 || !is_on_target(s, s->out.mean_energy)))
        s->outcome = SAMPLER_STALLED; /* what was put back or replaced is not at rest */
    ok = true;
done:
    free(job.residual);
    return ok;
}

const sampler_points *sampler_result_points(const sampler *s)
{
    return &s->out;
}
