// SPDX-License-Identifier: Apache-2.0
/* separate_patches: moves particles of one patch away from those of another patch that passes through it, and
 * particles away from others of their patch at the same place (passes.h). Particles of different patches do
 * not repel each other, and patches that intersect without a common curve have no samples along the
 * intersection. On parts thinner than the spacing several particles may be projected to one place, where
 * no force separates them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "base/core/sets.h"
#include "geometry/space/cell_list.h"
#include "sampling/solver/passes/passes.h"
#include "sampling/voronoi/resolution.h"

/* Particles of different patches within this distance are too close, in spacings. A little above the distance
 * of close pairs in the measures (0.25), because the particles around relax afterwards. */
static const double CLOSE_DISTANCE = 0.27;
/* Particles of one patch within this distance are at the same place, in spacings: that of coincident
 * points in the measures. */
static const double COINCIDENT_DISTANCE = 1e-3;
/* Length of the displacement along the surface, in spacings. Larger: nearer to the particles of its own
 * patch. */
static const double DISPLACEMENT = 0.3;
/* Number of directions that are tried. */
enum { DIRECTIONS = 12 };
/* The object that messages about memory name. */
static const char *const WHAT = "the separation of particles";

typedef struct separation {
    solver *s;
    const cell_list *near; /* of the positions before the pass */
    uint32_t *joined;      /* per patch: the least patch of its connected component */
    bool *is_close;        /* per particle */
} separation;

/* The search for the nearest particle that particle i would repel at x if patches did not matter. */
typedef struct nearest_search {
    const separation *job;
    size_t i;
    vec3 x;
    double own_patch2; /* particles of its patch count within this squared distance */
    double least2;
} nearest_search;

static void visit_particle(void *context, uint32_t j)
{
    nearest_search *search = context;
    const particles *p = search->job->s->state.p;
    const uint32_t own = p->patch[search->i], other = p->patch[j];
    const double distance2 = vec3_norm2(vec3_sub(p->position[j], search->x));
    if (j == search->i || (own == other && distance2 > search->own_patch2) ||
        search->job->joined[own] != search->job->joined[other])
        return;
    double facing = vec3_dot(p->normal[search->i], p->normal[j]);
    if (particles_is_one_sided(p, search->i) || particles_is_one_sided(p, j)) facing = fabs(facing);
    if (facing > RESOLUTION_OPPOSITE) search->least2 = fmin(search->least2, distance2);
}

static double own_spacing(const separation *job, size_t i)
{
    return job->s->state.spacing * particles_size(job->s->state.p, i);
}

/* Distance of the nearest other particle from x, in spacings of particle i; INFINITY if none is within
 * DISPLACEMENT and CLOSE_DISTANCE. Particles of its patch count within own_patch spacings. Particles that
 * this pass has moved are found at their new positions. */
static double distance_of_nearest(const separation *job, size_t i, vec3 x, double own_patch)
{
    const double h = own_spacing(job, i);
    nearest_search search = {job, i, x, own_patch * h * own_patch * h, INFINITY};
    cell_list_within(job->near, x, (2 * DISPLACEMENT + CLOSE_DISTANCE) * h, visit_particle, &search);
    return sqrt(search.least2) / h;
}

static bool is_too_close(const separation *job, size_t i)
{
    return !particles_is_fixed(job->s->state.p, i) &&
           distance_of_nearest(job, i, job->s->state.p->position[i], COINCIDENT_DISTANCE) < CLOSE_DISTANCE;
}

static void close_chunk(void *context, int worker, size_t begin, size_t end)
{
    separation *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) job->is_close[i] = is_too_close(job, i);
}

/* Moves a particle to the place around it that is farthest from all others, and fixes it there: its patch
 * would push it back. False if no place is better. */
static bool move_away(const separation *job, size_t i)
{
    particles *p = job->s->state.p;
    const field *f = particles_field(p, job->s->setup.field, i);
    const double h = own_spacing(job, i);
    const vec3 from = p->position[i];
    vec3 axis1, axis2, best = from, best_normal = p->normal[i];
    const double distance_now = distance_of_nearest(job, i, from, INFINITY);
    const double least = distance_now < COINCIDENT_DISTANCE ? distance_now : CLOSE_DISTANCE;
    double farthest = least;
    vec3_frame(p->normal[i], &axis1, &axis2);
    for (int k = 0; k < DIRECTIONS; k++) {
        const double angle = 2 * M_PI * k / DIRECTIONS;
        vec3 x = vec3_axpy(DISPLACEMENT * h * elementary_cos(angle), axis1,
                           vec3_axpy(DISPLACEMENT * h * elementary_sin(angle), axis2, from)),
             normal = p->normal[i];
        uint32_t hint = p->hint[i];
        if (!solver_project_point(f, h, DISPLACEMENT * h, &hint, &x, &normal) ||
            !field_is_within_near(f, x, &hint))
            continue;
        const double distance = distance_of_nearest(job, i, x, INFINITY);
        if (distance <= farthest) continue;
        farthest = distance;
        best = x;
        best_normal = normal;
    }
    if (farthest == least) return false;
    p->position[i] = best;
    p->normal[i] = best_normal;
    p->place[i] = PARTICLES_PINNED;
    p->hint[i] = FIELD_NO_HINT;
    solver_mark_displaced(job->s, i);
    return true;
}

static void join_patches(const field_patches *patches, uint32_t *joined)
{
    sets_reset(joined, patches->count);
    for (size_t c = 0; c < patches->curve_count; c++) {
        const uint32_t *patch = &patches->curve_patch[patches->curve[c].patch_first];
        for (size_t k = 1; k < patches->curve[c].patch_count; k++) sets_join(joined, patch[0], patch[k]);
    }
    for (uint32_t k = 0; k < patches->count; k++) joined[k] = sets_root(joined, k);
}

bool solver_separate_patches(solver *s, bool *changed, error *e)
{
    const particles *p = s->state.p;
    if (!solver_merges_near_curves(s)) return true;
    vec3 *before = mem_array(p->count, sizeof *before, WHAT, e);
    separation job = {.s = s,
                      .joined = mem_array(p->patches->count, sizeof *job.joined, WHAT, e),
                      .is_close = mem_array(p->count, sizeof *job.is_close, WHAT, e)};
    cell_list *near = NULL;
    if (before && job.joined && job.is_close) {
        memcpy(before, p->position, p->count * sizeof *before);
        join_patches(p->patches, job.joined);
        near = cell_list_new(before, p->count, s->setup.pool, e);
    }
    if (near) {
        job.near = near;
        threads_run(s->setup.pool, p->count, THREADS_GRAIN, close_chunk, &job);
        for (size_t i = 0; i < p->count && !threads_stopped(s->setup.pool); i++)
            if (job.is_close[i] && is_too_close(&job, i)) *changed |= move_away(&job, i);
    }
    const bool ok = near != NULL;
    cell_list_free(near);
    free(before);
    free(job.joined);
    free(job.is_close);
    return ok;
}
