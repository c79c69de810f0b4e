/* hold: a solve that has ended goes on with some particles held at given places, see sampler_hold. */
#include <math.h>
#include <stdlib.h>

#include "sampler/sampler_internal.h"

/* How far a particle may be from the place that it goes to, in spacings. */
static const double FARTHEST = 1.5;
/* A place is on a patch that it is so near to, in spacings. */
static const double ON_PATCH = 0.01;
/* A particle that looks the other way may be on another sheet: it counts as so many times as far. */
static const double OTHER_SHEET = 2;

/* Particles that are held or on curves do not give way: so near to one of them, in spacings, no other is held. */
static const double BESIDE_FIXED = 0.3;

/* Where a particle would be held. */
typedef struct hold {
    size_t particle;
    double distance;
    vec3 at, normal;
} hold;

/* Whether a particle may go to a place, nearer than the best so far. */
static bool is_nearer(const sampler *s, size_t i, vec3 place, hold *best)
{
    const particles *p = s->state.p;
    const double h = s->state.spacing * particles_size(p, i);
    hold own = {i, vec3_norm(vec3_sub(p->position[i], place)), place, p->normal[i]};
    if (particles_is_fixed(p, i) || own.distance >= fmin(best->distance, FARTHEST * h)) return false;
    const field *f = particles_field(p, s->setup.field, i);
    if (!sampler_land(f, h, ON_PATCH * h, &own.at, &own.normal) || !field_is_within(f, own.at)) return false;
    if (!particles_is_one_sided(p, i) && vec3_dot(own.normal, p->normal[i]) < 0) own.distance *= OTHER_SHEET;
    if (own.distance >= best->distance) return false;
    *best = own;
    return true;
}

static bool is_beside_fixed(const sampler *s, const hold *to)
{
    const particles *p = s->state.p;
    for (size_t i = 0; i < p->count; i++)
        if (particles_is_fixed(p, i) && vec3_dot(p->normal[i], to->normal) > 0 &&
            vec3_norm(vec3_sub(p->position[i], to->at)) <
                BESIDE_FIXED * s->state.spacing * particles_size(p, i))
            return true;
    return false;
}

/* The nearest particle of its patch goes to a place, for good. */
static bool hold_at(sampler *s, vec3 place)
{
    particles *p = s->state.p;
    hold best = {.distance = INFINITY};
    bool found = false;
    for (size_t i = 0; i < p->count; i++) found |= is_nearer(s, i, place, &best);
    if (!found || is_beside_fixed(s, &best)) return false;
    p->position[best.particle] = best.at;
    p->normal[best.particle] = best.normal;
    p->place[best.particle] = PARTICLES_HELD;
    return true;
}

bool sampler_hold(sampler *s, const vec3 *place, size_t count, bool *goes_on, error *e)
{
    size_t held = 0;
    *goes_on = false;
    if (s->state.outcome != SAMPLER_CONVERGED || !s->state.p->place || sampler_is_given(s) ||
        s->state.coarse || 2 * s->record.sweep_count >= (size_t)s->setup.params.max_sweeps)
        return true;
    for (size_t k = 0; k < count; k++) held += hold_at(s, place[k]);
    if (held == 0) return true;
    sampler_take_back(s);
    s->scratch.relax = sampler_new_relax(s, s->scratch.capacity, e);
    if (!s->scratch.relax) return false;
    *goes_on = true;
    sampler_go_on(s);
    if (!sampler_build_lists(s, e)) return false;
    for (size_t i = 0; i < s->state.p->count; i++)
        if (s->state.p->place[i] == PARTICLES_HELD) sampler_stir(s, i);
    s->state.sweeps_in_round = 0; /* a long round before says nothing of how these particles creep */
    s->state.gain = s->setup.schedule->gain[s->state.stage];
    s->state.recalls = 0;
    return true;
}
