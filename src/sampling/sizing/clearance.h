// SPDX-License-Identifier: Apache-2.0
/* clearance: the factor by which a spacing is too coarse to separate opposite walls of a surface.
 *
 * Points are sampled uniformly from the surface. From each, rays are traced to both sides, along the normal
 * and at an angle to it, to the first wall that faces the point. The walls are separated if the spacing is at
 * most the largest one at which no bound of sampling/voronoi/resolution.h holds at the end of any ray. Walls
 * closer than half a cell, or on patches an eighth of the spacing, count as that distance apart. Walls that meet beside
 * the point in a blunt edge or a tip do not count: no spacing separates them there.
 */
#ifndef HEXAD_SAMPLING_SIZING_CLEARANCE_H
#define HEXAD_SAMPLING_SIZING_CLEARANCE_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "sampling/sizing/sizing_field.h"
#include "surface/scan/surface.h"

typedef struct clearance {
    /* fraction of the surface at which walls are not separated at the given spacing */
    double unresolved_share;
    /* Factor of the spacing at which all of the surface except the fraction `allowed` is resolved; 1: it is
     * resolved at the given spacing. If the spacing varies, the factor applies everywhere. */
    double factor;
    /* The factor of walls that are as close as the smallest measured distance, or closer: `factor` is an
     * upper bound if it equals this value. 0 if the spacing varies. */
    double least_factor;
} clearance;

/* Measures the requested spacing: `sizing`, or if that is NULL the uniform spacing h, world units.
 * `allowed`: see clearance.factor. Errors: limit_memory, cancelled. Deterministic for any number of
 * threads. */
bool clearance_measure(const surface *scan, const sizing_field *sizing, double h, threads *pool,
                       double allowed, clearance *out, error *e);

/* The spacing that separates walls at this distance, as clearance_measure computes it. */
double clearance_spacing(double distance);

#endif
