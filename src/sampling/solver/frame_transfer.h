// SPDX-License-Identifier: Apache-2.0
/* frame_transfer: moves the points of one frame onto the surface of the next frame, so that each point keeps
 * its position on the surface.
 *
 * First all points move with the surface as a whole (sampling/solver/registration). Then each point moves
 * along the gradient onto the surface. A point dies if it does not reach the surface, if its projection is on
 * an opposite wall, or if it is closer to another point than neighbours can be. Where no point is near, a new
 * one is born. Then points are born in the emptiest places, or removed from the densest ones, until the count
 * is met. Many births or deaths are divided into portions of points far from each other, with a few sweeps
 * between the portions. If most points die, the surface is considered a different one: nothing is
 * transferred, and the caller samples it anew. Deterministic for any number of threads. World space and world
 * units.
 *
 * On a surface of patches, the points on curves are placed anew, by the quota of each patch. A place on a
 * curve continues the nearest point of the previous frame, if one is near. Each other point goes to the patch
 * that is nearest to its position after the motion of the whole. Each patch is a part with its own number of
 * points.
 */
#ifndef HEXAD_SAMPLING_SOLVER_FRAME_TRANSFER_H
#define HEXAD_SAMPLING_SOLVER_FRAME_TRANSFER_H

#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/isa.h"
#include "base/core/threads.h"
#include "surface/field/field.h"
#include "sampling/solver/registration.h"
#include "sampling/sizing/sizing_field.h"
#include "surface/scan/surface.h"

/* The parent of a born point. */
#define FRAME_TRANSFER_NONE UINT32_MAX

typedef struct frame_transfer_params {
    size_t previous_count;      /* >= 1 */
    const vec3 *position;       /* positions of the points of the previous frame */
    const vec3 *normal;         /* unit */
    const uint32_t *patch;      /* the patch of each, if it is known; NULL: that of the nearest place */
    size_t count;               /* number of points of the result */
    const sizing_field *sizing; /* NULL: uniform */
    /* sweeps with the energy of the kernel run between portions of births and deaths */
    bool eased;
    isa isa; /* instruction set of these sweeps */
    uint64_t seed;
    /* the points lie on this surface, which has not moved: it is never considered a different one */
    bool is_still;
    /* Points that the result has at exactly these positions, with the unit normals of the surface; fewer
     * than `count`. Points of the previous frame near them die. A fixed point near a curve sample of its patch
     * replaces it. fixed_patch: the patch of each; NULL without patches. */
    size_t fixed_count;
    const vec3 *fixed, *fixed_normal;
    const uint32_t *fixed_patch;
} frame_transfer_params;

typedef struct frame_transfer {
    /* number of points, as requested; 0, without arrays: the surface is a different one, and all points have
     * died */
    size_t count;
    /* a point on a curve has one particle for each of its patches, any other point has one */
    size_t particles;
    size_t died, born;
    registration motion;
    /* Arrays of the particles, in Morton order. */
    vec3 *position; /* on the surface */
    vec3 *normal;
    uint32_t *patch; /* the patch of each particle, on a surface with patches; otherwise NULL */
    /* with patches: the index of the curve sample, PARTICLES_FREE, or PARTICLES_PINNED for fixed points */
    uint32_t *place;
    /* Values of each point, in the order of its first particles. */
    /* the position to which the point was moved, before births and deaths displaced it; undefined for a
     * born point */
    vec3 *landed;
    /* the position in the previous frame; for a born point, the position that it would have had */
    vec3 *origin;
    uint32_t *parent; /* its index in the previous frame, or FRAME_TRANSFER_NONE */
    uint32_t *fixed; /* its index among the fixed points, or FRAME_TRANSFER_NONE; NULL without fixed points */
} frame_transfer;

/* Errors: limit_memory, no_surface (points cannot be placed), spec_invalid (fixed points leave
 * too few points for curves, or no place for others), cancelled (the pool was stopped). Free *out
 * also after failure. */
bool frame_transfer_points(const field *f, const surface *scan, const frame_transfer_params *params,
                           threads *pool, frame_transfer *out, error *e);
void frame_transfer_free(frame_transfer *c);

#endif
