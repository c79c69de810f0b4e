/* hold: a solve that has ended goes on with some particles held at given places, see solver_pin. */
#include <math.h>
#include <stdlib.h>

#include "solver/passes/passes.h"

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
static bool is_nearer(const solver *s, size_t i, vec3 place, hold *best)
{
    const particles *p = s->state.p;
    const double h = s->state.spacing * particles_size(p, i);
    hold own = {i, vec3_norm(vec3_sub(p->position[i], place)), place, p->normal[i]};
    if (particles_is_fixed(p, i) || own.distance >= fmin(best->distance, FARTHEST * h)) return false;
    const field *f = particles_field(p, s->setup.field, i);
    if (!solver_project_point(f, h, ON_PATCH * h, &own.at, &own.normal) || !field_is_within(f, own.at))
        return false;
    if (!particles_is_one_sided(p, i) && vec3_dot(own.normal, p->normal[i]) < 0) own.distance *= OTHER_SHEET;
    if (own.distance >= best->distance) return false;
    *best = own;
    return true;
}

static bool is_beside_fixed(const solver *s, const hold *to)
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
static bool hold_at(solver *s, vec3 place)
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

size_t solver_pin_near(solver *s, const vec3 *place, size_t count)
{
    size_t held = 0;
    for (size_t k = 0; k < count; k++) held += hold_at(s, place[k]);
    return held;
}
