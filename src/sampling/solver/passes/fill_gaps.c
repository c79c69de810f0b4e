// SPDX-License-Identifier: Apache-2.0
/* fill_gaps: relocates particles to uncovered places (passes.h). On an under-resolved surface, such as smoke
 * sampled with few points, the particles are distributed evenly in space, not on each part of the surface. On
 * a surface with patches, patches without a point get one. */
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "surface/field/projection.h"
#include "sampling/voronoi/resolution.h"
#include "sampling/solver/particles/coverage.h"
#include "sampling/solver/particles/random_streams.h"
#include "sampling/solver/particles/relocation.h"
#include "sampling/solver/passes/passes.h"

/* A surface is under-resolved if the resolved points are fewer than this fraction and condition
 * ORDERED_SHARE holds. */
static const double RESOLVED_SHARE = 0.5;
/* The points with six neighbours are fewer than this fraction. On a thin plate no point is resolved, but
 * both walls are ordered. */
static const double ORDERED_SHARE = 0.5;
/* Number of points that the resolution test samples. The fractions are mostly accurate to 0.01. */
enum { TEST_POINTS = 8000 };
/* Candidate places per particle. More: finer search, more time. */
enum { PLACES_PER_PARTICLE = 5 };
/* Maximum number of relocation passes; they end earlier if no particle moves. */
enum { MAX_PASSES = 6 };
/* Minimum number of candidate places per patch, so that small patches have some. */
enum { MIN_PATCH_PLACES = 4 };
/* A random place of a patch is a gap beyond this distance from all points, in spacings. */
static const double PATCH_GAP = 1;
/* The same for places of the exhaustive search: just below the distance beside a vacancy (1). */
static const double EXHAUSTIVE_GAP = 0.97;
/* Without patches: beyond this distance a connected part may have no point, in spacings. Smaller gaps
 * close during relaxation. */
static const double PART_GAP = 1.2;
/* A relocated particle must be projected to within this distance of its target, in spacings. Farther away may
 * be a point. Targets on patches lie up to one grid cell off the surface. */
static const double MAX_TARGET_DISTANCE = 0.25;
/* Over-dense distance of a second try that moves particles of patches with more points than they need, in
 * spacings. */
static const double SECOND_DENSE_DISTANCE = 0.95;
/* The object that messages about memory name. */
static const char *const WHAT = "the gaps in coverage";

bool solver_is_under_resolved(solver *s, bool *is_under_resolved, error *e)
{
    const particles *p = s->state.p;
    /* the test is expensive */
    if (!s->setup.fast || p->patch || relax_divergent_share(s->scratch.relax, p) < RELAX_MOSTLY_DIVERGENT)
        return true;
    double *spacing = mem_array(p->count, sizeof *spacing, "the result", e);
    if (!spacing) return false;
    solver_spacings(s, spacing);
    const resolution_input in = {.count = p->count,
                                 .position = p->position,
                                 .normal = p->normal,
                                 .spacing = spacing,
                                 .open = s->setup.field->open,
                                 .domain = s->setup.field->boundary_box,
                                 .every = p->count / TEST_POINTS};
    resolution r;
    bool ok = resolution_measure(&in, s->setup.pool, &r, e);
    free(spacing);
    if (!ok) return false;
    *is_under_resolved = r.resolved < RESOLVED_SHARE && r.hex < ORDERED_SHARE;
    return true;
}

/* Candidate places for relocated particles. */
typedef struct candidates {
    vec3 *place;
    uint32_t *near;     /* per place: relocation_input.near */
    uint32_t *patch;    /* per place; NULL without patches */
    bool *immovable;    /* per particle: relocation_input.immovable */
    uint32_t *of_patch; /* per patch: its number of particles; NULL without patches */
    size_t count;
    double gap, dense; /* relocation_input.gap, relocation_input.dense */
} candidates;

/* One relocation pass. *moves: the number of relocated particles. */
static bool relocate(solver *s, const candidates *d, size_t *moves, error *e)
{
    particles *p = s->state.p;
    if (!particles_add_sizes(p, e)) return false;
    const relocation_input in = {.point = p->position,
                                 .size = p->size,
                                 .count = p->count,
                                 .h = s->state.spacing,
                                 .place = d->place,
                                 .places = d->count,
                                 .gap = d->gap,
                                 .dense = d->dense,
                                 .immovable = d->immovable,
                                 .near = d->near};
    relocation *chosen = NULL;
    size_t count = 0;
    bool ok = relocation_choose(&in, s->setup.pool, &chosen, &count, e);
    *moves = 0;
    for (size_t k = 0; ok && k < count; k++) {
        const uint32_t point = chosen[k].point, place = chosen[k].place;
        const field *f = field_of_patch(s->setup.field, d->patch ? d->patch[place] : 0);
        if (d->patch && d->of_patch[p->patch[point]] == 1) continue; /* the last particle of its patch */
        vec3 x = d->place[place], normal = {0, 0, 1};
        const double near = MAX_TARGET_DISTANCE * s->state.spacing * particles_size(p, d->near[place]),
                     cell = s->setup.field->cell_size;
        uint32_t hint = FIELD_NO_HINT;
        if (!solver_project_point(f, s->state.spacing, d->patch || cell < near ? cell : near, &hint, &x,
                                  &normal)) {
            d->place[place] = p->position[point]; /* covered: discards the candidate */
            continue;
        }
        if (s->record.replaced) { /* NULL at the start of a level, when all particles are new */
            solver_mark_displaced(s, point);
            s->record.replaced[point] = true;
        }
        p->position[point] = x;
        p->normal[point] = normal;
        if (d->patch) {
            d->of_patch[p->patch[point]]--;
            p->patch[point] = d->patch[place];
            p->hint[point] = hint;
            d->of_patch[p->patch[point]]++;
        }
        ++*moves;
    }
    free(chosen);
    if (*moves > 0) solver_renew_sizes(s); /* relocated particles have the spacing of their old position */
    return ok;
}

typedef struct draw_job {
    const solver *s;
    size_t total;
    uint64_t seed;
    vec3 *place;
    bool *projected;
} draw_job;

static void draw_chunk(void *context, int worker, size_t begin, size_t end)
{
    const draw_job *job = context;
    const solver *s = job->s;
    const projection_limits limits = projection_draft(s->state.spacing);
    surface_last_cell last;
    (void)worker;
    last.known = false;
    for (size_t k = begin; k < end; k++) {
        rng r = rng_seed(job->seed, k); /* per place: independent of the number of threads */
        double where = ((double)k + rng_uniform(&r)) / (double)job->total;
        const vec3 from = sizing_field_draw(s->setup.params.sizing, s->setup.scan, where, &r, &last);
        vec3 normal;
        job->place[k] = from;
        job->projected[k] = projection_find(s->setup.field, &limits, &job->place[k], &normal) &&
                            vec3_norm(vec3_sub(job->place[k], from)) <= s->setup.field->cell_size;
    }
}

/* Draws candidates with the density of the sizing field. Candidates whose projection succeeded are moved to
 * the front. Returns their number. `projected`: scratch. */
static size_t draw_candidates(const solver *s, vec3 *out, bool *projected)
{
    rng r = rng_seed(s->setup.params.seed, RANDOM_STREAM_RELOCATION);
    draw_job job = {s, PLACES_PER_PARTICLE * s->state.p->count, rng_next(&r), out, projected};
    size_t found = 0;
    threads_run(s->setup.pool, job.total, THREADS_GRAIN, draw_chunk, &job);
    for (size_t k = 0; k < job.total && !threads_stopped(s->setup.pool); k++)
        if (projected[k]) out[found++] = out[k];
    return found;
}

bool solver_spread_points(solver *s, bool *changed, error *e)
{
    const size_t most = PLACES_PER_PARTICLE * s->state.p->count;
    bool *projected = mem_array(most, sizeof *projected, WHAT, e);
    candidates d = {.place = mem_array(most, sizeof *d.place, WHAT, e),
                    .near = mem_array(most, sizeof *d.near, WHAT, e)};
    bool ok = projected && d.place && d.near;
    if (ok) d.count = draw_candidates(s, d.place, projected);
    size_t moves = d.count;
    for (int pass = 0; ok && moves > 0 && pass < MAX_PASSES; pass++) {
        ok = relocate(s, &d, &moves, e);
        *changed |= moves > 0;
    }
    free(projected);
    free(d.place);
    free(d.near);
    return ok;
}

/* ---- patches */

/* Number of candidate places on a patch. */
static size_t patch_places(const solver *s, uint32_t patch)
{
    const double *weight = sizing_field_weight(s->setup.params.sizing, s->setup.scan);
    const double share = surface_part_share(s->setup.scan, weight, patch);
    return MIN_PATCH_PLACES + (size_t)(PLACES_PER_PARTICLE * share * (double)s->state.p->count);
}

typedef struct patch_draw_job {
    const solver *s;
    const size_t *first; /* per patch: its first place */
    uint64_t seed;
    candidates *d;
    bool *projected;
} patch_draw_job;

static void patch_chunk(void *context, int worker, size_t begin, size_t end)
{
    const patch_draw_job *job = context;
    const solver *s = job->s;
    const double *weight = sizing_field_weight(s->setup.params.sizing, s->setup.scan);
    (void)worker;
    for (size_t patch = begin; patch < end; patch++) {
        rng r = rng_seed(job->seed, patch); /* per patch: independent of the number of threads */
        const field *f = field_of_patch(s->setup.field, (uint32_t)patch);
        const size_t first = job->first[patch], count = job->first[patch + 1] - first;
        for (size_t k = 0; k < count; k++) {
            const double where = ((double)k + rng_uniform(&r)) / (double)count;
            vec3 *x = &job->d->place[first + k], normal = {0, 0, 1};
            uint32_t hint;
            job->d->patch[first + k] = (uint32_t)patch;
            job->projected[first + k] =
                surface_patch_point(s->setup.scan, weight, (uint32_t)patch, where, &r, x, &hint) &&
                solver_project_point(f, s->state.spacing, s->setup.field->cell_size, &hint, x, &normal) &&
                field_is_within_near(f, *x, &hint);
        }
    }
}

/* Draws candidates on all patches into d, which has the capacity. Candidates whose projection succeeded are
 * moved to the front and counted in d->count. */
static void draw_patch_candidates(const solver *s, const size_t *first, candidates *d, bool *projected)
{
    const size_t patches = s->setup.field->patches->count;
    rng r = rng_seed(s->setup.params.seed, RANDOM_STREAM_RELOCATION);
    patch_draw_job job = {s, first, rng_next(&r), d, projected};
    threads_run(s->setup.pool, patches, 16, patch_chunk, &job);
    d->count = 0;
    for (size_t k = 0; k < first[patches] && !threads_stopped(s->setup.pool); k++) {
        if (!projected[k]) continue;
        d->patch[d->count] = d->patch[k];
        d->place[d->count++] = d->place[k];
    }
}

/* Sets immovable[i] of particles that must not move: fixed, on boundaries, on curves, or the only one of
 * their patch. Sets of_patch. */
static void find_immovable(const solver *s, uint32_t *of_patch, bool *immovable)
{
    const particles *p = s->state.p;
    if (!p->patch) {
        for (size_t i = 0; i < p->count; i++)
            immovable[i] =
                particles_is_fixed(p, i) || projection_boundary_axes(s->setup.field, p->position[i]) != 0;
        return;
    }
    memset(of_patch, 0, s->setup.field->patches->count * sizeof *of_patch);
    for (size_t i = 0; i < p->count; i++) of_patch[p->patch[i]]++;
    for (size_t i = 0; i < p->count; i++)
        immovable[i] = particles_is_fixed(p, i) || of_patch[p->patch[i]] == 1;
}

/* Exhaustive search for gaps instead of random candidates. Each pass fills some gaps and searches again. */
static bool fill_all_gaps(solver *s, bool *changed, error *e)
{
    const size_t patches = s->setup.field->patches ? s->setup.field->patches->count : 0;
    particles *p = s->state.p;
    double *spacing = mem_array(p->count, sizeof *spacing, WHAT, e);
    candidates d = {.immovable = mem_array(p->count, sizeof *d.immovable, WHAT, e),
                    .of_patch = mem_array(patches, sizeof *d.of_patch, WHAT, e),
                    .gap = EXHAUSTIVE_GAP};
    bool ok = spacing && d.immovable && d.of_patch;
    size_t moves = 1;
    solver_renew_sizes(s);
    for (int pass = 0; ok && moves > 0 && pass < MAX_PASSES; pass++) {
        coverage_gaps gaps;
        solver_spacings(s, spacing);
        find_immovable(s, d.of_patch, d.immovable);
        ok = coverage_find_gaps(s->setup.scan, p->position, spacing, p->count, EXHAUSTIVE_GAP, &gaps, e);
        d.place = gaps.place;
        d.patch = patches > 0 ? gaps.patch : NULL;
        d.count = gaps.count;
        d.near = ok ? mem_array(gaps.count, sizeof *d.near, WHAT, e) : NULL;
        moves = 0;
        d.dense = 0;
        if (ok && gaps.count > 0) ok = d.near && relocate(s, &d, &moves, e);
        d.dense = SECOND_DENSE_DISTANCE;
        if (ok && gaps.count > 0 && moves == 0) ok = relocate(s, &d, &moves, e);
        *changed |= moves > 0;
        free(d.near);
        coverage_gaps_free(&gaps);
        ok = ok && threads_may_go_on(s->setup.pool, e);
    }
    free(spacing);
    free(d.immovable);
    free(d.of_patch);
    return ok;
}

bool solver_fill_parts(solver *s, bool *changed, error *e)
{
    double farthest = PART_GAP;
    solver_renew_sizes(s);
    double *spacing = mem_array(s->state.p->count, sizeof *spacing, WHAT, e);
    if (spacing) solver_spacings(s, spacing);
    const bool ok = spacing && coverage_measure(s->setup.scan, s->state.p->position, spacing,
                                                s->state.p->count, s->setup.pool, &farthest, e);
    free(spacing);
    return ok && (!(farthest > PART_GAP) || fill_all_gaps(s, changed, e));
}

bool solver_fill_gaps(solver *s, bool *changed, error *e)
{
    const size_t patches = s->setup.field->patches ? s->setup.field->patches->count : 0;
    if (patches == 0) return true;
    if (s->setup.field->patches->has_many_parts) return fill_all_gaps(s, changed, e);
    size_t *first = mem_array(patches + 1, sizeof *first, WHAT, e);
    for (uint32_t k = 0; first && k < patches; k++) first[k + 1] = first[k] + patch_places(s, k);
    const size_t most = first ? first[patches] : 0;
    bool *projected = mem_array(most, sizeof *projected, WHAT, e);
    candidates d = {.place = mem_array(most, sizeof *d.place, WHAT, e),
                    .near = mem_array(most, sizeof *d.near, WHAT, e),
                    .patch = mem_array(most, sizeof *d.patch, WHAT, e),
                    .immovable = mem_array(s->state.p->count, sizeof *d.immovable, WHAT, e),
                    .of_patch = mem_array(patches, sizeof *d.of_patch, WHAT, e),
                    .gap = PATCH_GAP};
    bool ok = first && projected && d.of_patch && d.place && d.near && d.patch && d.immovable;
    if (ok) {
        draw_patch_candidates(s, first, &d, projected);
        find_immovable(s, d.of_patch, d.immovable);
    }
    size_t moves = d.count;
    for (int pass = 0; ok && moves > 0 && pass < MAX_PASSES; pass++) {
        ok = relocate(s, &d, &moves, e);
        *changed |= moves > 0;
    }
    free(first);
    free(projected);
    free(d.place);
    free(d.near);
    free(d.patch);
    free(d.immovable);
    free(d.of_patch);
    return ok;
}
