/* coarse: the answer where a count resolves nothing of a surface, as of smoke with few points: what is spread evenly then is
 * not each sheet but the whole in space. See sampler_internal.h. */
#include <stdlib.h>

#include "base/memory.h"
#include "packing/quality.h"
#include "particles/random_streams.h"
#include "packing/relocation.h"
#include "sampler/sampler_internal.h"

/* Unless so many see others turned from them it is not asked, which takes time, whether a surface is resolved. */
static const double CREASED_SHARE = 0.5;
/* Fewer than this have a cell, and fewer than this have six neighbours. On a thin plate none has a cell, and yet both its
 * sheets are in order. */
static const double RESOLVED_SHARE = 0.5, ORDERED_SHARE = 0.5;
/* Points that are asked: what so many say of the shares is mostly off by less than a hundredth. */
enum { JUDGES = 8000 };
/* Places that are drawn for each particle, and how often some of the particles go to such. */
enum { PLACES = 5, PASSES = 6 };

bool sampler_judge_coarse(sampler *s, error *e)
{
    const particles *p = s->state.p;
    if (!s->setup.fast || p->patch || relax_creased_share(s->scratch.relax, p) < CREASED_SHARE) return true;
    double *spacing = mem_array(p->count, sizeof *spacing, "the result", e);
    if (!spacing) return false;
    for (size_t i = 0; i < p->count; i++) spacing[i] = p->size[i] * s->state.spacing;
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
    s->state.coarse = q.resolved_share < RESOLVED_SHARE && q.all.hex_fraction < ORDERED_SHARE;
    if (s->state.coarse) relax_look_through(s->scratch.relax);
    return true;
}

/* One pass; *moves particles have gone to another place. */
static bool relocate(sampler *s, const vec3 *place, size_t places, uint32_t *near, size_t *moves, error *e)
{
    particles *p = s->state.p;
    const relocation_input in = {
        p->position, p->size, p->count, s->state.spacing, place, places, s->setup.params.list_limit, near};
    relocation *chosen = NULL;
    size_t count = 0;
    bool ok = relocation_choose(&in, s->setup.pool, &chosen, &count, e);
    *moves = 0;
    for (size_t k = 0; ok && k < count; k++) {
        vec3 x = place[chosen[k].place], normal = {0, 0, 1};
        if (!sampler_land(s->setup.field, s->state.spacing, s->setup.field->cell_size, &x, &normal)) continue;
        p->position[chosen[k].point] = x;
        p->normal[chosen[k].point] = normal;
        s->record.replaced[chosen[k].point] = true;
        ++*moves;
    }
    free(chosen);
    return ok;
}

typedef struct places_job {
    const sampler *s;
    size_t wanted;
    uint64_t seed;
    vec3 *place;
    bool *landed;
} places_job;

static void draw_chunk(void *context, int worker, size_t begin, size_t end)
{
    const places_job *job = context;
    const sampler *s = job->s;
    surface_last_cell last;
    (void)worker;
    last.known = false;
    for (size_t k = begin; k < end; k++) {
        rng r = rng_seed(job->seed, k); /* of its own, so that threads do not show */
        double where = ((double)k + rng_uniform(&r)) / (double)job->wanted;
        vec3 normal = {0, 0, 1};
        job->place[k] = sizing_field_draw(s->setup.params.sizing, s->setup.scan, where, &r, &last);
        job->landed[k] = sampler_land(s->setup.field, s->state.spacing, s->setup.field->cell_size,
                                      &job->place[k], &normal);
    }
}

/* Places all over the surface, in proportion to what the spacing asks for: PLACES for each particle, of which `landed` says
 * whether they are on it. Returns how many are, which come first. */
static size_t draw_places(const sampler *s, vec3 *out, bool *landed)
{
    rng r = rng_seed(s->setup.params.seed, RANDOM_STREAM_RELOCATION);
    places_job job = {s, PLACES * s->state.p->count, rng_next(&r), out, landed};
    size_t found = 0;
    threads_run(s->setup.pool, job.wanted, 256, draw_chunk, &job);
    for (size_t k = 0; k < job.wanted && !threads_stopped(s->setup.pool); k++)
        if (landed[k]) out[found++] = out[k];
    return found;
}

bool sampler_relocate(sampler *s, error *e)
{
    const char *what = "the bare places";
    vec3 *place = mem_array(PLACES * s->state.p->count, sizeof *place, what, e);
    bool *landed = mem_array(PLACES * s->state.p->count, sizeof *landed, what, e);
    uint32_t *near = mem_array(PLACES * s->state.p->count, sizeof *near, what, e);
    bool ok = place && landed && near;
    size_t places = ok ? draw_places(s, place, landed) : 0, moves = places;
    for (int pass = 0; ok && moves > 0 && pass < PASSES; pass++)
        ok = relocate(s, place, places, near, &moves, e);
    free(place);
    free(landed);
    free(near);
    return ok && sampler_settle(s, e);
}
