// SPDX-License-Identifier: Apache-2.0
/* witkin_heckbert_solver: the method of Witkin and Heckbert as a solver_method (solver_state.h). Formulas:
 * witkin_heckbert.c. */
#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "surface/field/projection.h"
#include "sampling/packing/neighbours.h"
#include "geometry/space/packing.h"
#include "sampling/solver/particles/population.h"
#include "sampling/solver/particles/random_streams.h"
#include "sampling/solver/solver_state.h"

/* Verlet skin of the lists beyond the widest Gaussian, over the mean radius. */
static const double SKIN = 0.5;
/* Distance of twins from the position of their particle over its radius. */
static const double TWIN_OFFSET = 0.5;
/* Maximum factor on a radius in one step. */
static const double RADIUS_FACTOR = 2;
/* Maximum radius over sigma_max: limits the growth of a particle whose split fails. */
static const double MAX_RADIUS = 2;
/* Maximum distance of a particle from the surface over its radius; beyond it the step is projected. */
static const double MAX_OFF_SURFACE = 0.05;
/* Maximum number of projection steps. */
static const int MAX_PROJECTION_STEPS = 5;
/* Convergence requires this number of steps without fission and death. */
enum { QUIET_STEPS = 100 };
/* Minimum number of steps of a round of the report. */
enum { ROUND_STEPS = 50 };
/* Number of samples of the amplitude for the scale of varied radii. */
enum { SCALE_SAMPLES = 2000 };

/* A particle within one step, and what the step decides about it. */
typedef struct particle_step {
    vec3 place, normal; /* of the next step; place: the new position */
    vec3 anchor;        /* position at the last list build */
    double grown;       /* the next sigma */
    witkin_heckbert_terms terms;
    bool splits;
    bool refused; /* the step failed: the particle does not move */
} particle_step;

typedef struct witkin_heckbert_state {
    witkin_heckbert_params params;
    energy_function energy; /* Gaussian; its ideal is the desired energy */
    double packing;         /* spacing over sigma of the ideal packing */
    double band; /* mean radius over the target radius: the middle of the range without fission and death */
    double sigma_hat; /* target radius for an amplitude of 1 */
    double sigma_max;
    size_t capacity;
    double *sigma;
    vec3 *velocity;
    particle_step *of;
    bool *dies; /* in this step */
    neighbours *near;
    double cutoff; /* of the lists */
    bool lists_stale;
    rng life;  /* random numbers of fission and death */
    int quiet; /* steps since the last fission or death */
    size_t round_inserted, round_deleted;
} witkin_heckbert_state;

static void free_columns(witkin_heckbert_state *w)
{
    free(w->sigma);
    free(w->velocity);
    free(w->of);
    free(w->dies);
    neighbours_free(w->near);
}

static void release(solver *s)
{
    witkin_heckbert_state *w = s->state.witkin_heckbert;
    if (!w) return;
    free_columns(w);
    free(w);
    s->state.witkin_heckbert = NULL;
}

/* Increases the capacity; keeps sigma and the steps. Velocities are valid within one step only. */
static bool reserve(solver *s, size_t capacity, error *e)
{
    witkin_heckbert_state *w = s->state.witkin_heckbert, larger = *w;
    const char *what = "particles";
    if (capacity <= w->capacity) return true;
    size_t limit = s->setup.params.count_limit, extended = capacity + capacity / 2;
    if (limit > 0 && extended > limit && capacity <= limit) extended = limit;
    if (!solver_reserve(s, extended, e)) return false;
    larger.capacity = extended;
    larger.sigma = mem_array(extended, sizeof *larger.sigma, what, e);
    larger.velocity = mem_array(extended, sizeof *larger.velocity, what, e);
    larger.of = mem_array(extended, sizeof *larger.of, what, e);
    larger.dies = mem_array(extended, sizeof *larger.dies, what, e);
    larger.near = neighbours_new(extended, s->setup.params.list_limit, e);
    if (!larger.sigma || !larger.velocity || !larger.of || !larger.dies || !larger.near) {
        free_columns(&larger);
        return false;
    }
    if (w->sigma) memcpy(larger.sigma, w->sigma, s->state.p->count * sizeof *w->sigma);
    if (w->of) memcpy(larger.of, w->of, w->capacity * sizeof *w->of);
    if (w->dies) memcpy(larger.dies, w->dies, w->capacity * sizeof *w->dies);
    free_columns(w);
    *w = larger;
    w->lists_stale = true;
    return true;
}

/* Spacing over amplitude for which the count equals that of a uniform spacing: the root of the mean of
 * alpha^-2 over the area. */
static double amplitude_scale(const solver *s)
{
    if (!s->setup.params.graded) return 1;
    rng r = rng_seed(s->setup.params.seed, RANDOM_STREAM_WITKIN_HECKBERT_RADII);
    double sum = 0;
    int found = 0;
    for (int k = 0; k < SCALE_SAMPLES; k++) {
        field_sample sample;
        double alpha;
        vec3 x = surface_point(s->setup.scan, s->setup.scan->area_before,
                               (k + 0.5) / SCALE_SAMPLES * s->setup.scan->area, &r, NULL);
        if (!field_sample_at(s->setup.field, x, FIELD_GRADIENT, &sample) ||
            !solver_amplitude_at(s, s->setup.field, SCALED_CURVATURE_ALL, x, vec3_unit(sample.gradient),
                                 &alpha))
            continue;
        sum += 1 / (alpha * alpha);
        found++;
    }
    return found > 0 ? sqrt(sum / found) : 1;
}

static double target_radius(const solver *s, size_t i)
{
    return s->state.witkin_heckbert->sigma_hat * (s->setup.params.graded ? s->state.p->alpha[i] : 1);
}

static bool begin(solver *s, error *e)
{
    witkin_heckbert_state *w = s->state.witkin_heckbert = mem_alloc(sizeof *w);
    w->params = *s->setup.params.witkin_heckbert;
    w->energy = energy_gaussian;
    w->energy.ideal = w->params.e_hat * w->params.alpha;
    s->setup.params.energy = &w->energy;
    w->packing = witkin_heckbert_packing(&w->params);
    w->band = 0.5 * (1 + w->params.delta);
    w->sigma_hat = s->state.spacing / w->packing / w->band * amplitude_scale(s);
    w->sigma_max = w->params.sigma_max > 0 ? w->params.sigma_max
                                           : fmax(0.5 * bbox_longest(s->setup.scan->box),
                                                  1.5 * s->state.spacing / w->packing / w->band);
    w->life = rng_seed(s->setup.params.seed, RANDOM_STREAM_WITKIN_HECKBERT);
    s->state.sigma = s->state.spacing / w->packing;
    if (!reserve(s, s->state.p->count, e)) return false;
    for (size_t i = 0; i < s->state.p->count; i++) w->sigma[i] = s->state.sigma;
    return true;
}

/* ---- a step ---- */

static double widest_radius(const solver *s)
{
    double widest = 0;
    for (size_t i = 0; i < s->state.p->count; i++) widest = fmax(widest, s->state.witkin_heckbert->sigma[i]);
    return widest;
}

/* Builds the lists again after fission or death, or if displacements or radii exceed their reach. */
static bool update_lists(solver *s, error *e)
{
    witkin_heckbert_state *w = s->state.witkin_heckbert;
    double reach = WITKIN_HECKBERT_REACH * widest_radius(s), moved2 = 0;
    if (!w->lists_stale) {
        for (size_t i = 0; i < s->state.p->count; i++)
            moved2 = fmax(moved2, vec3_norm2(vec3_sub(s->state.p->position[i], w->of[i].anchor)));
        if (reach + 2 * sqrt(moved2) < w->cutoff) return true;
    }
    w->cutoff = reach + SKIN * s->state.sigma;
    if (!neighbours_build(w->near, s->state.p->count, s->state.p->position, NULL, w->cutoff, s->setup.pool,
                          e))
        return false;
    for (size_t i = 0; i < s->state.p->count; i++) w->of[i].anchor = s->state.p->position[i];
    w->lists_stale = false;
    return true;
}

/* Forces, and the velocities by forces and constraint (2). */
static void velocity_chunk(void *context, int worker, size_t begin, size_t end)
{
    solver *s = context;
    witkin_heckbert_state *w = s->state.witkin_heckbert;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        field_sample sample;
        witkin_heckbert_terms *t = &w->of[i].terms;
        witkin_heckbert_sum(&w->params, s->state.p->position, w->sigma, i, neighbours_list(w->near, i),
                            w->near->list_count[i], t);
        s->state.p->energy[i] = (float)t->energy;
        w->velocity[i] = (vec3){0, 0, 0};
        vec3 x = s->state.p->position[i];
        if (!field_sample_at(s->setup.field, x, FIELD_GRADIENT, &sample)) continue;
        double g2 = vec3_norm2(sample.gradient);
        if (!(g2 > 0)) continue;
        if (s->setup.params.graded)
            solver_amplitude_at(s, s->setup.field, SCALED_CURVATURE_ALL, x,
                                vec3_scale(sample.gradient, 1 / sqrt(g2)), &s->state.p->alpha[i]);
        double along = (vec3_dot(sample.gradient, t->push) + w->params.phi * sample.value) / g2;
        w->velocity[i] = vec3_axpy(-along, sample.gradient, t->push);
    }
}

/* Euler step to `place`, projected if it is too far from the surface. If the projection fails, the particle
 * does not move. The velocity becomes the actual displacement over dt, so that the radii follow it: at
 * edges and boundaries it differs from that of the forces. */
static void place_chunk(void *context, int worker, size_t begin, size_t end)
{
    solver *s = context;
    witkin_heckbert_state *w = s->state.witkin_heckbert;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        double sigma = w->sigma[i], length = w->params.dt * vec3_norm(w->velocity[i]);
        double share = length > sigma ? sigma / length : 1;
        const projection_limits limits = {MAX_PROJECTION_STEPS, MAX_OFF_SURFACE * sigma, 0,
                                          MAX_OFF_SURFACE * sigma};
        vec3 old = s->state.p->position[i], x = vec3_axpy(share * w->params.dt, w->velocity[i], old);
        w->of[i].normal = s->state.p->normal[i];
        w->of[i].refused = !projection_find(s->setup.field, &limits, &x, &w->of[i].normal) ||
                           vec3_norm(vec3_sub(x, old)) > RADIUS_FACTOR * sigma;
        if (w->of[i].refused) x = old;
        w->of[i].place = x;
        w->velocity[i] = vec3_scale(vec3_sub(x, old), 1 / w->params.dt);
    }
}

static void grow_chunk(void *context, int worker, size_t begin, size_t end)
{
    solver *s = context;
    witkin_heckbert_state *w = s->state.witkin_heckbert;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        double sigma = w->sigma[i];
        double rate =
            witkin_heckbert_radius_rate(&w->params, s->state.p->position, w->velocity, w->sigma, i,
                                        neighbours_list(w->near, i), w->near->list_count[i], &w->of[i].terms);
        double grown = fmin(fmax(sigma + w->params.dt * rate, sigma / RADIUS_FACTOR), sigma * RADIUS_FACTOR);
        w->of[i].grown = fmin(grown, MAX_RADIUS * w->sigma_max);
    }
}

static void take_step(solver *s)
{
    witkin_heckbert_state *w = s->state.witkin_heckbert;
    for (size_t i = 0; i < s->state.p->count; i++) {
        if (!w->of[i].refused) s->state.p->normal[i] = w->of[i].normal;
        s->state.p->position[i] = w->of[i].place;
        w->sigma[i] = w->of[i].grown;
    }
}

/* Sets splits and dies by the radii and energies of this step. */
static void choose_fission_and_death(solver *s, size_t *splits, size_t *deaths)
{
    witkin_heckbert_state *w = s->state.witkin_heckbert;
    const witkin_heckbert_params *params = &w->params;
    *splits = *deaths = 0;
    for (size_t i = 0; i < s->state.p->count; i++) {
        double sigma = w->sigma[i], target = target_radius(s, i);
        bool is_slow = vec3_norm(w->velocity[i]) < params->gamma * sigma;
        bool filled = (double)s->state.p->energy[i] > params->nu * w->energy.ideal && sigma > target;
        w->of[i].splits = is_slow && (sigma > w->sigma_max || filled);
        w->dies[i] = is_slow && sigma < params->delta * target &&
                     rng_uniform(&w->life) > sigma / (params->delta * target);
        *splits += w->of[i].splits;
        *deaths += w->dies[i];
    }
}

/* Fission and death; *inserted and *deleted: their numbers. At least four particles remain. */
static bool fission_and_death(solver *s, size_t *inserted, size_t *deleted, error *e)
{
    witkin_heckbert_state *w = s->state.witkin_heckbert;
    size_t before = s->state.p->count, splits, deaths;
    choose_fission_and_death(s, &splits, &deaths);
    *inserted = *deleted = 0;
    if (before + splits < deaths + 4) deaths = 0;
    if (splits + deaths == 0) return true;
    if (!reserve(s, before + splits, e)) return false;
    for (size_t i = 0; i < before; i++) {
        if (!w->of[i].splits ||
            !population_split(s->setup.field, s->state.p, i, TWIN_OFFSET * w->sigma[i], &w->life))
            continue;
        w->sigma[i] /= sqrt(2);
        w->sigma[s->state.p->count - 1] = w->sigma[i];
        ++*inserted;
    }
    if (deaths > 0) {
        for (size_t i = before; i < s->state.p->count; i++) w->dies[i] = false;
        size_t kept = 0;
        for (size_t i = 0; i < s->state.p->count; i++)
            if (!w->dies[i]) w->sigma[kept++] = w->sigma[i];
        *deleted = population_remove(s->state.p, w->dies);
    }
    w->lists_stale = true;
    s->state.spacing = packing_spacing(s->setup.scan->area, (double)s->state.p->count);
    return true;
}

static void record_step(solver *s, size_t inserted, size_t deleted, double energy, double rms,
                        uint64_t rejected)
{
    witkin_heckbert_state *w = s->state.witkin_heckbert;
    s->record.sweep[s->record.sweep_count++] =
        (solver_sweep){energy, 0, rms, s->state.p->count, s->state.sigma, rejected, inserted, deleted};
    w->round_inserted += inserted;
    w->round_deleted += deleted;
    s->state.sweeps_in_round++;
    int length = s->setup.params.max_sweeps / SOLVER_MAX_ROUNDS + 1;
    bool ends = s->state.sweeps_in_round >= (length > ROUND_STEPS ? length : ROUND_STEPS);
    if (!ends && s->state.outcome == SOLVER_RUNNING) return;
    solver_note_round(s, ends ? "interval" : "ended", energy, 0);
    s->record.round[s->record.round_count - 1].inserted = w->round_inserted;
    s->record.round[s->record.round_count - 1].deleted = w->round_deleted;
    s->state.round_cause = "interval";
    s->state.sweeps_in_round = 0;
    w->round_inserted = w->round_deleted = 0;
}

static bool step(solver *s, error *e)
{
    witkin_heckbert_state *w = s->state.witkin_heckbert;
    if (!update_lists(s, e)) return false;
    threads_run(s->setup.pool, s->state.p->count, THREADS_GRAIN, velocity_chunk, s);
    threads_run(s->setup.pool, s->state.p->count, THREADS_GRAIN, place_chunk, s);
    threads_run(s->setup.pool, s->state.p->count, THREADS_GRAIN, grow_chunk, s);
    take_step(s);
    double energy = 0, squares = 0, radii = 0, n = (double)s->state.p->count;
    uint64_t rejected = 0;
    for (size_t i = 0; i < s->state.p->count; i++) {
        energy += (double)s->state.p->energy[i];
        squares += vec3_norm2(w->velocity[i]);
        radii += w->sigma[i];
        rejected += w->of[i].refused;
    }
    double rms = w->params.dt * sqrt(squares / n) / s->state.spacing;
    s->state.sigma = radii / n;
    size_t inserted, deleted;
    if (!fission_and_death(s, &inserted, &deleted, e)) return false;
    w->quiet = inserted + deleted > 0 ? 0 : w->quiet + 1;
    /* the remaining displacement is estimated by that of a unit of time, not by that of the Euler step */
    if (w->quiet >= QUIET_STEPS && rms < s->setup.params.step_tolerance * w->params.dt)
        s->state.outcome = solver_is_on_target(s, energy / n) && s->state.p->count == s->setup.params.count
                               ? SOLVER_CONVERGED
                               : SOLVER_STALLED;
    else if (s->record.sweep_count + 1 == (size_t)s->setup.params.max_sweeps)
        s->state.outcome = SOLVER_OUT_OF_SWEEPS;
    record_step(s, inserted, deleted, energy / n, rms, rejected);
    s->state.fraction = (double)s->record.sweep_count / (double)s->setup.params.max_sweeps;
    return true;
}

/* ---- the end ---- */

/* Energies and neighbours are those of the particles' own Gaussians; the requested spacing is that of the
 * target radii. */
static bool describe(solver *s, error *e)
{
    witkin_heckbert_state *w = s->state.witkin_heckbert;
    size_t n = s->state.p->count, near = 0;
    w->lists_stale = true;
    if (!update_lists(s, e)) return false;
    threads_run(s->setup.pool, n, THREADS_GRAIN, velocity_chunk, s);
    double *spacing = solver_column(s, COLUMN_SPACING), *energy = solver_column(s, COLUMN_ENERGY);
    s->record.out.mean_energy = 0;
    s->record.out.step_left = s->record.out.step_without_kinks = NAN; /* there are no Newton steps (12) */
    for (size_t i = 0; i < n; i++) {
        s->record.out.mean_energy += w->of[i].terms.energy / (double)n;
        near += w->of[i].terms.near;
        spacing[i] = w->packing * w->band * target_radius(s, i);
        energy[i] = w->of[i].terms.energy;
    }
    s->record.out.mean_neighbours = (double)near / (double)n;
    return true;
}

const solver_method solver_witkin_heckbert = {begin, step, describe, release};
