// SPDX-License-Identifier: Apache-2.0
/* project: projects every particle onto the surface to rounding and relocates those for which that fails
 * (solver_project). */
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "surface/field/projection.h"
#include "geometry/space/cell_list.h"
#include "sampling/solver/particles/random_streams.h"
#include "sampling/solver/passes/passes.h"

/* Maximum residual |F| / |grad F| of a final particle over h. Above it the particle is relocated. */
static const double MAX_RESIDUAL = 1e-6;
/* Random places from which a relocated particle gets the one that is farthest from all particles. */
static const int REPLACEMENT_DRAWS = 30;
/* Places that a lost particle gets in turn until one can be projected to rounding. */
static const int REPLACEMENT_TRIES = 5;
/* A free particle within this distance of a curve of its patch is among the samples of the curve, in
 * spacings. */
static const double ON_CURVE_DISTANCE = 0.3;
/* Such a particle is relocated to a place with at least this distance from all particles, in spacings. */
static const double MIN_PLACE_DISTANCE = 0.6;
/* Otherwise it is moved off the curve, towards the free particles within this distance, in spacings. */
static const double OFF_CURVE_RADIUS = 1.5;
/* Maximum number of projection steps. */
static const int MAX_STEPS = 20;
/* Maximum displacement by the final projection over h. A relaxed particle is within 0.01 h of the surface; a
 * larger displacement is a failure of Newton's method. */
static const double MAX_DISPLACEMENT = 0.05;

/* Projection to rounding: a Newton step from a residual of 1e-7 h leaves less than the resolution of
 * doubles. */
projection_limits solver_rounding(double h)
{
    return (projection_limits){MAX_STEPS, 1e-9 * h, 1e-7 * h, MAX_RESIDUAL * h};
}

bool solver_project_point(const field *f, double h, double farthest, uint32_t *hint, vec3 *x, vec3 *normal)
{
    const projection_limits limits = solver_rounding(h);
    vec3 q = *x, n = *normal;
    if (projection_find_near(f, &limits, hint, &q, &n) && vec3_norm(vec3_sub(q, *x)) <= farthest) {
        *x = q;
        *normal = n;
        return true;
    }
    return projection_bisect(f, *normal, farthest, x, normal);
}

/* The same within MAX_DISPLACEMENT, with the field sample at the result. `along`: direction of the
 * bisection. */
static bool project_with_sample(const field *f, double h, vec3 along, uint32_t *hint, vec3 *x,
                                field_sample *sample)
{
    const projection_limits limits = solver_rounding(h);
    const double farthest = MAX_DISPLACEMENT * h;
    vec3 q = *x;
    if (projection_sample(f, &limits, hint, &q, sample) && vec3_norm(vec3_sub(q, *x)) <= farthest) {
        *x = q;
        return true;
    }
    return projection_bisect(f, along, farthest, x, &along) &&
           field_sample_near(f, *x, FIELD_GRADIENT, hint, sample);
}

/* Residual over min(h, grid cell size) from which a Newton step on a smooth F needs no verification: it
 * leaves at most 1e-10. */
static const double SMOOTH_SHORTCUT = 1e-5;

/* The same for a smooth F. *normal is the normal at the last but one iterate. */
static bool project_smoothly(const field *f, double h, uint32_t *hint, vec3 *x, vec3 *normal)
{
    projection_limits limits = solver_rounding(h);
    limits.shortcut = SMOOTH_SHORTCUT * fmin(h, f->cell_size);
    vec3 q = *x, n;
    if (!projection_find_near(f, &limits, hint, &q, &n) || vec3_norm(vec3_sub(q, *x)) > MAX_DISPLACEMENT * h)
        return false;
    *x = q;
    *normal = n;
    return true;
}

/* Projects particle i to rounding and sets scratch.lost[i] if that fails. Returns its residual |F| / |grad F|
 * over h. 0: it is lost, fixed, or of a smooth F. */
static double project_particle(solver *s, size_t i, uint32_t *last)
{
    uint32_t *hint = s->state.p->patch ? &s->state.p->hint[i] : last;
    vec3 x = s->state.p->position[i];
    const field *f = particles_field(s->state.p, s->setup.field, i);
    field_sample sample;
    s->scratch.lost[i] = !particles_is_fixed(s->state.p, i);
    if (!s->scratch.lost[i]) return 0;
    double h = s->state.spacing * particles_size(s->state.p, i);
    if (solver_ends_smoothly(s) && project_smoothly(f, h, hint, &x, &s->state.p->normal[i])) {
        s->scratch.lost[i] = false;
        s->state.p->position[i] = x;
        return 0;
    }
    if (!project_with_sample(f, h, s->state.p->normal[i], hint, &x, &sample) ||
        (s->state.p->patch && !field_is_within_near(f, x, hint)))
        return 0;
    double length = vec3_norm(sample.gradient), residual = fabs(sample.value) / length / h;
    if (!(residual < MAX_RESIDUAL)) return 0;
    s->scratch.lost[i] = false;
    s->state.p->position[i] = x;
    s->state.p->normal[i] = vec3_scale(sample.gradient, 1 / length);
    if (s->setup.params.graded)
        solver_amplitude_at(s, f, particles_patch(s->state.p, i), x, s->state.p->normal[i],
                            &s->state.p->alpha[i]);
    return residual;
}

static void project_chunk(void *context, int worker, size_t begin, size_t end)
{
    solver *s = context;
    uint32_t hint = FIELD_NO_HINT;
    double worst = 0;
    (void)worker;
    for (size_t i = begin; i < end; i++) worst = fmax(worst, project_particle(s, i, &hint));
    s->scratch.worst[begin / THREADS_GRAIN] = worst;
}

/* Whether a free particle has converged among the samples of a curve: the particles of its patch push it
 * outwards, and it cannot leave the patch. */
static bool is_among_curve_samples(const solver *s, size_t i)
{
    const particles *p = s->state.p;
    if (!p->patch || particles_is_fixed(p, i) || s->setup.params.blue_noise) return false;
    double distance = curve_distance_at(s->state.plan.curves, p->patch[i], p->position[i]);
    return distance < ON_CURVE_DISTANCE * s->state.spacing * particles_size(p, i);
}

/* Largest residual of a group that must be recomputed. */
static const double NOT_COMPUTED = -1;

/* Projects a relocated particle, after all others. */
static void project_again(solver *s, size_t i)
{
    project_particle(s, i, &(uint32_t){FIELD_NO_HINT});
    s->scratch.worst[i / THREADS_GRAIN] = NOT_COMPUTED;
}

/* Largest residual over h of the projected particles [begin, end). */
static double worst_residual(const solver *s, size_t begin, size_t end)
{
    double worst = 0;
    for (size_t i = begin; i < end; i++) {
        const double h = s->state.spacing * particles_size(s->state.p, i);
        field_sample sample;
        if (s->scratch.lost[i] || particles_is_fixed(s->state.p, i) ||
            !field_sample_at(particles_field(s->state.p, s->setup.field, i), s->state.p->position[i],
                             FIELD_GRADIENT, &sample))
            continue;
        worst = fmax(worst, fabs(sample.value) / vec3_norm(sample.gradient) / h);
    }
    return worst;
}

/* Relocates particle i to a random place of the surface, or of its patch. It tries several places and takes
 * the one farthest from its nearest particle. False: none is farther than `least` (world units; < 0: no
 * minimum). */
static bool replace(solver *s, const moving_cell_list *all, uint32_t i, double least, rng *r)
{
    const double *weight = sizing_field_weight(s->setup.params.sizing, s->setup.scan);
    const field *f = particles_field(s->state.p, s->setup.field, i);
    uint32_t patch = s->state.p->patch ? s->state.p->patch[i] : 0;
    double best = least < 0 ? -1 : least * least;
    bool found = false;
    vec3 x = s->state.p->position[i], normal = s->state.p->normal[i];
    for (int draw = 0; draw < REPLACEMENT_DRAWS; draw++) {
        vec3 q, n = {0, 0, 1};
        uint32_t hint;
        if (!surface_patch_point(s->setup.scan, weight, patch, rng_uniform(r), r, &q, &hint) ||
            !solver_project_point(f, s->state.spacing, s->setup.field->cell_size, &hint, &q, &n))
            continue;
        const double nearest2 = moving_cell_list_nearest2(all, q, i);
        if (nearest2 <= best) continue;
        best = nearest2;
        found = true;
        x = q;
        normal = n;
    }
    if (!found) return false;
    /* the forces of its patch did not keep it on the surface: fix it, and relax the particles around it in
     * the last rounds */
    if (s->state.p->patch && s->scratch.lost[i] && s->state.continuations >= SOLVER_CONTINUATIONS_MOST - 1)
        s->state.p->place[i] = PARTICLES_PINNED;
    solver_mark_displaced(s, i);
    s->state.p->position[i] = x;
    s->state.p->normal[i] = normal;
    s->record.removed++;
    s->record.replaced[i] = true;
    project_again(s, i);
    return true;
}

/* Moves a particle off a curve, towards the free particles of its patch. */
static void move_off_curve(solver *s, size_t i)
{
    const particles *p = s->state.p;
    const field *f = particles_field(p, s->setup.field, i);
    const double h = s->state.spacing * particles_size(p, i), around = OFF_CURVE_RADIUS * h;
    vec3 x = p->position[i], normal = p->normal[i], inwards = {0, 0, 0};
    for (size_t j = 0; j < p->count; j++) {
        vec3 side = vec3_sub(p->position[j], x);
        if (p->patch[j] == p->patch[i] && !particles_is_fixed(p, j) && vec3_norm2(side) < around * around)
            inwards = vec3_add(inwards, side);
    }
    inwards = vec3_axpy(-vec3_dot(inwards, normal), normal, inwards);
    x = vec3_axpy(ON_CURVE_DISTANCE * h, vec3_unit(inwards), x);
    uint32_t hint = p->hint[i];
    if (!solver_project_point(f, s->state.spacing, ON_CURVE_DISTANCE * h, &hint, &x, &normal) ||
        !field_is_within_near(f, x, &hint))
        return;
    solver_mark_displaced(s, i);
    s->state.p->position[i] = x;
    s->state.p->normal[i] = normal;
    project_again(s, i);
}

/* Relocates the particles that are lost or lie among curve samples. If near curves are merged and no
 * continuation is left, a particle may remain among curve samples. */
static bool replace_lost(solver *s, error *e)
{
    const particles *p = s->state.p;
    const bool may_stay = solver_merges_near_curves(s) && s->state.continuations >= SOLVER_CONTINUATIONS_MOST;
    uint32_t *moving = mem_array(p->count, sizeof *moving, "the result", e);
    size_t count = 0;
    for (uint32_t i = 0; moving && i < p->count; i++)
        if (s->scratch.lost[i] || (!may_stay && is_among_curve_samples(s, i))) moving[count++] = i;
    moving_cell_list *all =
        count > 0 ? moving_cell_list_new(p->position, p->count, moving, count, s->setup.pool, e) : NULL;
    rng r = rng_seed(s->setup.params.seed, RANDOM_STREAM_REPLACEMENT);
    for (size_t k = 0; all && k < count && !threads_stopped(s->setup.pool); k++) {
        const uint32_t i = moving[k];
        const double distance = MIN_PLACE_DISTANCE * s->state.spacing * particles_size(p, i);
        if (!s->scratch.lost[i]) {
            if (!replace(s, all, i, distance, &r)) move_off_curve(s, i);
            continue;
        }
        /* The projection to rounding may fail at the new place. */
        for (int tries = 0; tries < REPLACEMENT_TRIES && s->scratch.lost[i]; tries++)
            replace(s, all, i, -1, &r);
    }
    const bool ok = moving && (count == 0 || all);
    moving_cell_list_free(all);
    free(moving);
    return ok;
}

static void count_lost(solver *s)
{
    const size_t n = s->state.p->count;
    s->record.out.lost = 0;
    s->record.out.max_residual = 0;
    for (size_t i = 0; i < n; i++) s->record.out.lost += s->scratch.lost[i];
    for (size_t k = 0; k < n / THREADS_GRAIN + 1; k++) {
        const size_t begin = k * THREADS_GRAIN, end = begin + THREADS_GRAIN < n ? begin + THREADS_GRAIN : n;
        const double worst =
            s->scratch.worst[k] == NOT_COMPUTED ? worst_residual(s, begin, end) : s->scratch.worst[k];
        s->record.out.max_residual = fmax(s->record.out.max_residual, worst);
    }
}

bool solver_project(solver *s, bool *changed, error *e)
{
    const size_t before = s->record.removed;
    size_t n = s->state.p->count;
    s->scratch.worst = mem_array(n / THREADS_GRAIN + 1, sizeof *s->scratch.worst, "the result", e);
    s->scratch.lost = mem_array(n, sizeof *s->scratch.lost, "the result", e);
    if (!s->record.replaced) s->record.replaced = mem_array(n, sizeof *s->record.replaced, "the result", e);
    s->state.is_projected = s->scratch.worst && s->scratch.lost && s->record.replaced;
    if (s->state.is_projected) {
        threads_run(s->setup.pool, n, THREADS_GRAIN, project_chunk, s);
        s->state.is_projected = replace_lost(s, e);
    }
    if (s->state.is_projected) count_lost(s);
    free(s->scratch.worst);
    free(s->scratch.lost);
    s->scratch.worst = NULL;
    s->scratch.lost = NULL;
    *changed |= s->record.removed != before;
    return s->state.is_projected;
}
