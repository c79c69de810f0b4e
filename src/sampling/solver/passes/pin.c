// SPDX-License-Identifier: Apache-2.0
/* pin: moves particles to given places and fixes them there (solver_pin). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/compare.h"
#include "base/core/memory.h"
#include "geometry/space/cell_list.h"
#include "sampling/solver/passes/passes.h"

/* Maximum distance of a particle from its place, in spacings. */
static const double MAX_DISTANCE = 1.5;
/* A place belongs to a patch within this distance, in spacings. */
static const double PATCH_DISTANCE = 0.01;
/* Factor on the distance of a particle with an opposite normal: it may be on the opposite wall. */
static const double OPPOSITE_FACTOR = 2;
/* No particle is pinned within this distance of a fixed particle, in spacings: neither could give way. */
static const double MIN_FIXED_DISTANCE = 0.3;

/* Factor on the radius of searches, so that rounding excludes no particle. */
static const double SEARCH_MARGIN = 1.0001;

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
    uint32_t hint = FIELD_NO_HINT;
    if (!solver_project_point(f, h, PATCH_DISTANCE * h, &hint, &own.at, &own.normal) ||
        !field_is_within_near(f, own.at, &hint))
        return false;
    if (!particles_is_one_sided(p, i) && vec3_dot(own.normal, p->normal[i]) < 0)
        own.distance *= OPPOSITE_FACTOR;
    if (own.distance >= best->distance) return false;
    *best = own;
    return true;
}

/* Search for particles by their positions before any particle was pinned. */
typedef struct pin_job {
    const solver *s;
    vec3 *before; /* positions before pinning */
    cell_list *cells;
    double largest;  /* largest spacing of a particle */
    double farthest; /* largest displacement of a pinned particle */
    uint32_t *near;  /* result of find_near; capacity for all particles */
    size_t near_count;
} pin_job;

static void add_near(void *context, uint32_t particle)
{
    pin_job *f = context;
    f->near[f->near_count++] = particle;
}

/* Finds the particles whose original position is within `reach` of x, in ascending order. */
static void find_near(pin_job *f, vec3 x, double reach)
{
    f->near_count = 0;
    cell_list_within(f->cells, x, reach * SEARCH_MARGIN, add_near, f);
    qsort(f->near, f->near_count, sizeof *f->near, compare_uint32);
}

static bool is_beside_fixed(pin_job *f, const pin *to)
{
    const particles *p = f->s->state.p;
    find_near(f, to->at, MIN_FIXED_DISTANCE * f->largest + f->farthest);
    for (size_t k = 0; k < f->near_count; k++) {
        const size_t i = f->near[k];
        if (particles_is_fixed(p, i) && vec3_dot(p->normal[i], to->normal) > 0 &&
            vec3_norm(vec3_sub(p->position[i], to->at)) <
                MIN_FIXED_DISTANCE * f->s->state.spacing * particles_size(p, i))
            return true;
    }
    return false;
}

/* Pins the nearest particle at a place. False: there is none, or a fixed particle is too near. The search
 * radius suffices, because only pinned particles have moved, and these cannot be pinned again. */
static bool pin_at(pin_job *f, vec3 place)
{
    particles *p = f->s->state.p;
    pin best = {.distance = INFINITY};
    bool found = false;
    find_near(f, place, MAX_DISTANCE * f->largest);
    for (size_t k = 0; k < f->near_count; k++) found |= is_nearer(f->s, f->near[k], place, &best);
    if (!found || is_beside_fixed(f, &best)) return false;
    f->farthest = fmax(f->farthest, vec3_norm(vec3_sub(best.at, p->position[best.particle])));
    p->position[best.particle] = best.at;
    p->normal[best.particle] = best.normal;
    p->place[best.particle] = PARTICLES_PINNED;
    return true;
}

bool solver_pin_near(solver *s, const vec3 *place, size_t count, size_t *pinned, error *e)
{
    const particles *p = s->state.p;
    pin_job f = {.s = s, .before = mem_array(p->count, sizeof *f.before, "pinned particles", e)};
    *pinned = 0;
    if (f.before) f.near = mem_array(p->count, sizeof *f.near, "pinned particles", e);
    if (f.near) {
        memcpy(f.before, p->position, p->count * sizeof *f.before);
        f.cells = cell_list_new(f.before, p->count, s->setup.pool, e);
    }
    for (size_t i = 0; f.cells && i < p->count; i++)
        f.largest = fmax(f.largest, s->state.spacing * particles_size(p, i));
    for (size_t k = 0; f.cells && k < count; k++) *pinned += pin_at(&f, place[k]);
    const bool ok = f.cells != NULL;
    cell_list_free(f.cells);
    free(f.near);
    free(f.before);
    return ok;
}
