/* coarse: the answer where a count resolves nothing of a surface, as of smoke with few points: what is spread evenly then is
 * not each sheet but the whole in space; and where it resolves not all patches, of which some have no point. See
 * solver_state.h. */
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "field/projection.h"
#include "voronoi/quality.h"
#include "solver/particles/coverage.h"
#include "solver/particles/random_streams.h"
#include "solver/particles/relocation.h"
#include "solver/passes/passes.h"

/* Unless so many see others turned from them it is not asked, which takes time, whether a surface is resolved. */
static const double CREASED_SHARE = 0.5;
/* Fewer than this have a cell, and fewer than this have six neighbours. On a thin plate none has a cell, and yet both its
 * sheets are in order. */
static const double RESOLVED_SHARE = 0.5, ORDERED_SHARE = 0.5;
/* Points that are asked: what so many say of the shares is mostly off by less than a hundredth. */
enum { JUDGES = 8000 };
/* Places that are drawn for each particle, and how often some of the particles go to such. */
enum { PLACES = 5, PASSES = 6 };
/* Besides, places that are drawn on each patch; and how far from all points one is that gets a point of another patch. */
enum { PLACES_OF_PATCH = 4 };
static const double BARE_PATCH = 1, BARE_PLACE = 0.97;
/* Of a surface without patches: with a place so far from all points a part of it may have none. Nearer ones fill up by themselves. */
static const double BARE_PART = 1.2;
/* Who goes to a place lands so near it, in spacings: farther away may be a point. Places of patches lie up to a cell off the surface. */
static const double LANDS_WITHIN = 0.25;
/* Where none crowds places of a patch may be bare all the same, since it has too few points: others have more than they need,
 * those who have another so near, and the nearest first. */
static const double PRESSED = 0.95;

bool solver_is_under_resolved(solver *s, bool *is_under_resolved, error *e)
{
    const particles *p = s->state.p;
    if (!s->setup.fast || p->patch || relax_divergent_share(s->scratch.relax, p) < CREASED_SHARE) return true;
    double *spacing = mem_array(p->count, sizeof *spacing, "the result", e);
    if (!spacing) return false;
    solver_spacings(s, spacing);
    const quality_input in = {.count = p->count,
                              .position = p->position,
                              .normal = p->normal,
                              .spacing = spacing,
                              .h = s->state.spacing,
                              .sized = s->setup.params.sizing != NULL,
                              .open = s->setup.field->open,
                              .domain = s->setup.field->boundary_box,
                              .every = p->count / JUDGES};
    quality q;
    bool ok = quality_measure(&in, s->setup.pool, NULL, NULL, &q, e);
    free(spacing);
    if (!ok) return false;
    *is_under_resolved = q.resolved_share < RESOLVED_SHARE && q.all.hex_fraction < ORDERED_SHARE;
    return true;
}

/* Places that are drawn, and what is noted of them. */
typedef struct drawn {
    vec3 *place;
    uint32_t *near;     /* see relocation_input */
    uint32_t *patch;    /* NULL: there are none */
    bool *held;         /* likewise; of each particle */
    uint32_t *of_patch; /* with patches: how many particles each has */
    size_t count;
    double bare, crowded; /* see relocation_input */
} drawn;

/* One pass; *moves particles have gone to another place. */
static bool relocate(solver *s, const drawn *d, size_t *moves, error *e)
{
    particles *p = s->state.p;
    if (!particles_add_sizes(p, e)) return false;
    const relocation_input in = {.point = p->position,
                                 .size = p->size,
                                 .count = p->count,
                                 .h = s->state.spacing,
                                 .place = d->place,
                                 .places = d->count,
                                 .bare = d->bare,
                                 .crowded = d->crowded,
                                 .held = d->held,
                                 .list_limit = s->setup.params.list_limit,
                                 .near = d->near};
    relocation *chosen = NULL;
    size_t count = 0;
    bool ok = relocation_choose(&in, s->setup.pool, &chosen, &count, e);
    *moves = 0;
    for (size_t k = 0; ok && k < count; k++) {
        const uint32_t point = chosen[k].point, place = chosen[k].place;
        const field *f = field_of_patch(s->setup.field, d->patch ? d->patch[place] : 0);
        if (d->patch && d->of_patch[p->patch[point]] == 1) continue; /* its patch has no other left */
        vec3 x = d->place[place], normal = {0, 0, 1};
        const double near = LANDS_WITHIN * s->state.spacing * particles_size(p, d->near[place]),
                     cell = s->setup.field->cell_size;
        if (!solver_project_point(f, s->state.spacing, d->patch || cell < near ? cell : near, &x, &normal)) {
            d->place[place] = p->position[point]; /* nor is it a place for another */
            continue;
        }
        if (s->record.replaced) { /* at a level's begin there are no lists yet, and all are in new places */
            solver_mark_displaced(s, point);
            s->record.replaced[point] = true;
        }
        p->position[point] = x;
        p->normal[point] = normal;
        if (d->patch) {
            d->of_patch[p->patch[point]]--;
            p->patch[point] = d->patch[place];
            p->hint[point] = FIELD_NO_HINT;
            d->of_patch[p->patch[point]]++;
        }
        ++*moves;
    }
    free(chosen);
    if (*moves > 0)
        solver_renew_sizes(s); /* else a place beside one from where points are denser is bare again */
    return ok;
}

typedef struct places_job {
    const solver *s;
    size_t wanted;
    uint64_t seed;
    vec3 *place;
    bool *landed;
} places_job;

/* Places are looked at from afar: so near to the surface, of the spacing, they need not be nearer. Who goes to one is landed. */
static const double PLACE_ACCEPT = 1e-3, PLACE_REJECT = 1e-2;
enum { PLACE_STEPS = 20 };

static void draw_chunk(void *context, int worker, size_t begin, size_t end)
{
    const places_job *job = context;
    const solver *s = job->s;
    const double h = s->state.spacing;
    const projection_limits limits = {PLACE_STEPS, PLACE_ACCEPT * h, PLACE_ACCEPT * h, PLACE_REJECT * h};
    surface_last_cell last;
    (void)worker;
    last.known = false;
    for (size_t k = begin; k < end; k++) {
        rng r = rng_seed(job->seed, k); /* of its own, so that threads do not show */
        double where = ((double)k + rng_uniform(&r)) / (double)job->wanted;
        const vec3 from = sizing_field_draw(s->setup.params.sizing, s->setup.scan, where, &r, &last);
        vec3 normal;
        job->place[k] = from;
        job->landed[k] = projection_find(s->setup.field, &limits, &job->place[k], &normal) &&
                         vec3_norm(vec3_sub(job->place[k], from)) <= s->setup.field->cell_size;
    }
}

/* Places all over the surface, in proportion to what the spacing asks for: PLACES for each particle, of which `landed` says
 * whether they are on it. Returns how many are, which come first. */
static size_t draw_places(const solver *s, vec3 *out, bool *landed)
{
    rng r = rng_seed(s->setup.params.seed, RANDOM_STREAM_RELOCATION);
    places_job job = {s, PLACES * s->state.p->count, rng_next(&r), out, landed};
    size_t found = 0;
    threads_run(s->setup.pool, job.wanted, 256, draw_chunk, &job);
    for (size_t k = 0; k < job.wanted && !threads_stopped(s->setup.pool); k++)
        if (landed[k]) out[found++] = out[k];
    return found;
}

bool solver_spread_points(solver *s, bool *changed, error *e)
{
    const char *what = "the bare places";
    const size_t most = PLACES * s->state.p->count;
    bool *landed = mem_array(most, sizeof *landed, what, e);
    drawn d = {.place = mem_array(most, sizeof *d.place, what, e),
               .near = mem_array(most, sizeof *d.near, what, e)};
    bool ok = landed && d.place && d.near;
    if (ok) d.count = draw_places(s, d.place, landed);
    size_t moves = d.count;
    for (int pass = 0; ok && moves > 0 && pass < PASSES; pass++) {
        ok = relocate(s, &d, &moves, e);
        *changed |= moves > 0;
    }
    free(landed);
    free(d.place);
    free(d.near);
    return ok;
}

/* ---- patches */

static size_t places_of_patch(const solver *s, uint32_t patch)
{
    const double *weight = sizing_field_weight(s->setup.params.sizing, s->setup.scan);
    const components *parts = &s->setup.scan->parts;
    const double share =
        (weight[parts->begin[patch + 1]] - weight[parts->begin[patch]]) / weight[s->setup.scan->cells];
    return PLACES_OF_PATCH + (size_t)(PLACES * share * (double)s->state.p->count);
}

typedef struct patches_job {
    const solver *s;
    const size_t *first; /* of each patch its first place */
    uint64_t seed;
    drawn *d;
    bool *landed;
} patches_job;

static void draw_patches(void *context, int worker, size_t begin, size_t end)
{
    const patches_job *job = context;
    const solver *s = job->s;
    const double *weight = sizing_field_weight(s->setup.params.sizing, s->setup.scan);
    (void)worker;
    for (size_t patch = begin; patch < end; patch++) {
        rng r = rng_seed(job->seed, patch); /* of its own, so that threads do not show */
        const field *f = field_of_patch(s->setup.field, (uint32_t)patch);
        const size_t first = job->first[patch], count = job->first[patch + 1] - first;
        for (size_t k = 0; k < count; k++) {
            const double where = ((double)k + rng_uniform(&r)) / (double)count;
            vec3 *x = &job->d->place[first + k], normal = {0, 0, 1};
            job->d->patch[first + k] = (uint32_t)patch;
            job->landed[first + k] =
                surface_patch_point(s->setup.scan, weight, (uint32_t)patch, where, &r, x) &&
                solver_project_point(f, s->state.spacing, s->setup.field->cell_size, x, &normal) &&
                field_is_within(f, *x);
        }
    }
}

/* Places on all patches; those that are on them come first, and are counted. Room for all is in `d`. */
static void draw_on_patches(const solver *s, const size_t *first, drawn *d, bool *landed)
{
    const size_t patches = s->setup.field->patches->count;
    rng r = rng_seed(s->setup.params.seed, RANDOM_STREAM_RELOCATION);
    patches_job job = {s, first, rng_next(&r), d, landed};
    threads_run(s->setup.pool, patches, 16, draw_patches, &job);
    d->count = 0;
    for (size_t k = 0; k < first[patches] && !threads_stopped(s->setup.pool); k++) {
        if (!landed[k]) continue;
        d->patch[d->count] = d->patch[k];
        d->place[d->count++] = d->place[k];
    }
}

/* Who stays: particles on boundaries, or curves, and those that are alone on their patch. */
static void hold_some(const solver *s, uint32_t *of_patch, bool *held)
{
    const particles *p = s->state.p;
    if (!p->patch) {
        for (size_t i = 0; i < p->count; i++)
            held[i] = projection_boundary_axes(s->setup.field, p->position[i]) != 0;
        return;
    }
    memset(of_patch, 0, s->setup.field->patches->count * sizeof *of_patch);
    for (size_t i = 0; i < p->count; i++) of_patch[p->patch[i]]++;
    for (size_t i = 0; i < p->count; i++) held[i] = particles_is_fixed(p, i) || of_patch[p->patch[i]] == 1;
}

/* Every place of the surface counts, whatever is drawn: of those that are bare some get a point, and then there may be others. */
static bool cover_all(solver *s, bool *changed, error *e)
{
    const char *what = "the bare places";
    const size_t patches = s->setup.field->patches ? s->setup.field->patches->count : 0;
    particles *p = s->state.p;
    double *spacing = mem_array(p->count, sizeof *spacing, what, e);
    drawn d = {.held = mem_array(p->count, sizeof *d.held, what, e),
               .of_patch = mem_array(patches, sizeof *d.of_patch, what, e),
               .bare = BARE_PLACE};
    bool ok = spacing && d.held && d.of_patch;
    size_t moves = 1;
    solver_renew_sizes(s);
    for (int pass = 0; ok && moves > 0 && pass < PASSES; pass++) {
        coverage_places bare;
        solver_spacings(s, spacing);
        hold_some(s, d.of_patch, d.held);
        ok = coverage_find_bare(s->setup.scan, p->position, spacing, p->count, BARE_PLACE, &bare, e);
        d.place = bare.place;
        d.patch = patches > 0 ? bare.patch : NULL;
        d.count = bare.count;
        d.near = ok ? mem_array(bare.count, sizeof *d.near, what, e) : NULL;
        moves = 0;
        d.crowded = 0;
        if (ok && bare.count > 0) ok = d.near && relocate(s, &d, &moves, e);
        d.crowded = PRESSED;
        if (ok && bare.count > 0 && moves == 0) ok = relocate(s, &d, &moves, e);
        *changed |= moves > 0;
        free(d.near);
        coverage_places_free(&bare);
        if (ok && threads_stopped(s->setup.pool)) ok = error_set(e, ERROR_CANCELLED, "stopped");
    }
    free(spacing);
    free(d.held);
    free(d.of_patch);
    return ok;
}

bool solver_fill_parts(solver *s, bool *changed, error *e)
{
    double farthest = BARE_PART;
    solver_renew_sizes(s);
    double *spacing = mem_array(s->state.p->count, sizeof *spacing, "the bare places", e);
    if (spacing) solver_spacings(s, spacing);
    const bool ok = spacing && coverage_measure(s->setup.scan, s->state.p->position, spacing,
                                                s->state.p->count, s->setup.pool, &farthest, e);
    free(spacing);
    return ok && (!(farthest > BARE_PART) || cover_all(s, changed, e));
}

bool solver_fill_gaps(solver *s, bool *changed, error *e)
{
    const char *what = "the bare places";
    const size_t patches = s->setup.field->patches ? s->setup.field->patches->count : 0;
    if (patches == 0) return true;
    if (s->setup.field->patches->has_many_parts) return cover_all(s, changed, e);
    size_t *first = mem_array(patches + 1, sizeof *first, what, e);
    for (uint32_t k = 0; first && k < patches; k++) first[k + 1] = first[k] + places_of_patch(s, k);
    const size_t most = first ? first[patches] : 0;
    bool *landed = mem_array(most, sizeof *landed, what, e);
    drawn d = {.place = mem_array(most, sizeof *d.place, what, e),
               .near = mem_array(most, sizeof *d.near, what, e),
               .patch = mem_array(most, sizeof *d.patch, what, e),
               .held = mem_array(s->state.p->count, sizeof *d.held, what, e),
               .of_patch = mem_array(patches, sizeof *d.of_patch, what, e),
               .bare = BARE_PATCH};
    bool ok = first && landed && d.of_patch && d.place && d.near && d.patch && d.held;
    if (ok) {
        draw_on_patches(s, first, &d, landed);
        hold_some(s, d.of_patch, d.held);
    }
    size_t moves = d.count;
    for (int pass = 0; ok && moves > 0 && pass < PASSES; pass++) {
        ok = relocate(s, &d, &moves, e);
        *changed |= moves > 0;
    }
    free(first);
    free(landed);
    free(d.place);
    free(d.near);
    free(d.patch);
    free(d.held);
    free(d.of_patch);
    return ok;
}
