/* pin: moves particles to given places and fixes them there (solver_pin). */
#include <math.h>
#include <stdlib.h>

#include "sampling/solver/passes/passes.h"

/* Maximum distance of a particle from its place, in spacings. */
static const double MAX_DISTANCE = 1.5;
/* A place belongs to a patch within this distance, in spacings. */
static const double PATCH_DISTANCE = 0.01;
/* Factor on the distance of a particle with an opposite normal: it may be on the opposite wall. */
static const double OPPOSITE_FACTOR = 2;
/* No particle is pinned within this distance of a fixed particle, in spacings: neither could give way. */
static const double MIN_FIXED_DISTANCE = 0.3;

/* A particle and the position where it would be pinned. */
typedef struct pin {
    size_t particle;
    double distance;
    vec3 at, normal;
} pin;

/* Whether particle i may be pinned at a place and is nearer than *best; then it replaces *best. */
static bool is_nearer(const solver *s, size_t i, vec3 place, pin *best)
{
    const particles *p = s->state.p;
    const double h = s->state.spacing * particles_size(p, i);
    pin own = {i, vec3_norm(vec3_sub(p->position[i], place)), place, p->normal[i]};
    if (particles_is_fixed(p, i) || own.distance >= fmin(best->distance, MAX_DISTANCE * h)) return false;
    const field *f = particles_field(p, s->setup.field, i);
    if (!solver_project_point(f, h, PATCH_DISTANCE * h, &own.at, &own.normal) || !field_is_within(f, own.at))
        return false;
    if (!particles_is_one_sided(p, i) && vec3_dot(own.normal, p->normal[i]) < 0)
        own.distance *= OPPOSITE_FACTOR;
    if (own.distance >= best->distance) return false;
    *best = own;
    return true;
}

static bool is_beside_fixed(const solver *s, const pin *to)
{
    const particles *p = s->state.p;
    for (size_t i = 0; i < p->count; i++)
        if (particles_is_fixed(p, i) && vec3_dot(p->normal[i], to->normal) > 0 &&
            vec3_norm(vec3_sub(p->position[i], to->at)) <
                MIN_FIXED_DISTANCE * s->state.spacing * particles_size(p, i))
            return true;
    return false;
}

/* Pins the nearest particle at a place. False if there is none or a fixed particle is too near. */
static bool pin_at(solver *s, vec3 place)
{
    particles *p = s->state.p;
    pin best = {.distance = INFINITY};
    bool found = false;
    for (size_t i = 0; i < p->count; i++) found |= is_nearer(s, i, place, &best);
    if (!found || is_beside_fixed(s, &best)) return false;
    p->position[best.particle] = best.at;
    p->normal[best.particle] = best.normal;
    p->place[best.particle] = PARTICLES_PINNED;
    return true;
}

size_t solver_pin_near(solver *s, const vec3 *place, size_t count)
{
    size_t pinned = 0;
    for (size_t k = 0; k < count; k++) pinned += pin_at(s, place[k]);
    return pinned;
}
