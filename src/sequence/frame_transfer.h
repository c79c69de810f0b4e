/* frame_transfer: moves the points of one frame onto the surface of the next frame, so that each point stays where it
 * was on the surface.
 *
 * First all points move with the surface as a whole (sequence/registration). Then each point moves along the gradient
 * onto the surface. A point dies when it does not reach the surface, when its projection is on an opposite wall, or
 * when it comes closer to another point than neighbours can be. Where no point is near a new one is born. Then
 * points are born in the emptiest places, or removed where they are densest, until the count is met: many in
 * portions, far from each other, with a few sweeps between the portions. When most points die the surface is another
 * one: then nothing is transferred, and the caller samples it anew. Deterministic for any number of threads. World
 * space and world units.
 *
 * On a surface of patches the points on curves are placed anew, by the quota of each patch. A place on a curve continues the
 * nearest point of the frame before, if one is near. Each other point goes to the patch that is nearest to where the motion of
 * the whole brings it. Each patch is a part with a number of points of its own. */
#ifndef HEXAD_SEQUENCE_FRAME_TRANSFER_H
#define HEXAD_SEQUENCE_FRAME_TRANSFER_H

#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/isa.h"
#include "base/threads.h"
#include "field/field.h"
#include "sequence/registration.h"
#include "sizing/sizing_field.h"
#include "surface/surface.h"

/* The parent of a point that was born. */
#define FRAME_TRANSFER_NONE UINT32_MAX

typedef struct frame_transfer_params {
    size_t previous_count;      /* >= 1 */
    const vec3 *position;       /* of the points of the frame before */
    const vec3 *normal;         /* unit */
    size_t count;               /* points there are to be */
    const sizing_field *sizing; /* NULL: even */
    bool eased;                 /* sweeps, of the kernel's energy, between portions of births and deaths */
    isa isa;                    /* of these sweeps */
    uint64_t seed;
    bool is_still; /* the points are of this surface: it has not moved, and is never another one */
    /* Points that are in the result at exactly these positions, with the unit normals of the surface; fewer than `count`. Points of the
     * frame before that are near them die. One near a place on a curve takes that place. */
    size_t fixed_count;
    const vec3 *fixed, *fixed_normal;
} frame_transfer_params;

typedef struct frame_transfer {
    size_t count; /* points, as requested; 0, and no arrays: the surface is another one, and all have died */
    size_t particles; /* a point on a curve is one for each patch there; else as many */
    size_t died, born;
    registration motion;
    /* Arrays of the particles, in Morton order. */
    vec3 *position; /* on the surface */
    vec3 *normal;
    uint32_t *patch; /* on a surface with patches the one that it lies on; else NULL */
    /* likewise: its number in the samples of the quota's curves, or PARTICLES_FREE; with fixed points PARTICLES_PINNED for these */
    uint32_t *place;
    /* Values of each point, in the order of its first particles. */
    vec3 *landed;     /* where it was carried to, before births and deaths moved it; of one born, no matter */
    vec3 *origin;     /* where it was in the frame before; of one that was born, where it would have been */
    uint32_t *parent; /* its index in the frame before, or FRAME_TRANSFER_NONE */
    uint32_t *fixed; /* its index among the fixed points, or FRAME_TRANSFER_NONE; NULL without fixed points */
} frame_transfer;

/* Errors: limit_memory, no_surface (points cannot be placed), cancelled (the pool was stopped). The
 * caller frees, also after failure. */
bool frame_transfer_points(const field *f, const surface *scan, const frame_transfer_params *params,
                           threads *pool, frame_transfer *out, error *e);
void frame_transfer_free(frame_transfer *c);

#endif
