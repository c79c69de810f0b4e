// SPDX-License-Identifier: Apache-2.0
/* scaled_curvature: the curvature of a surface over a given distance, not at a point.
 *
 * The curvature of a field at a point is that of its smallest details: the facets of a mesh, the noise of a
 * scan. Here it is the change of the normal over a neighbourhood: the symmetric 2 x 2 matrix S (the shape
 * operator) that minimises |n_j - n_i - S (x_j - x_i)|^2 in the tangent plane, with the weights exp(-(d /
 * scale)^2) and the means of both sides subtracted. On a sphere of radius R it is 1/R at any scale; an edge
 * with the dihedral angle deviation t has about t / scale. Opposite walls and other patches are excluded.
 *
 * Neighbourhoods consist of elements (sampling/sizing/elements.h). World space and world units. Immutable
 * after construction, any thread.
 */
#ifndef HEXAD_SAMPLING_SIZING_SCALED_CURVATURE_H
#define HEXAD_SAMPLING_SIZING_SCALED_CURVATURE_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "sampling/sizing/cell_samples.h"
#include "surface/scan/surface.h"

typedef struct scaled_curvature scaled_curvature;

/* The minimum distance: a cell of the surface. */
double scaled_curvature_least(const surface *scan);

/* `sample`: samples of the cells, read during the call. `scale` > 0; at least scaled_curvature_least is used.
 * Errors: limit_memory, cancelled. Deterministic for any number of threads. */
scaled_curvature *scaled_curvature_new(const surface *scan, const cell_samples *sample, double scale,
                                       threads *pool, error *e);
void scaled_curvature_free(scaled_curvature *c);

/* The distance that is used: the requested one, or a cell. */
double scaled_curvature_scale(const scaled_curvature *c);

/* All patches. */
#define SCALED_CURVATURE_ALL UINT32_MAX

/* The curvature sqrt(kappa1^2 + kappa2^2) at x, which is on the surface or this patch of it and has the unit
 * normal. It is interpolated between elements and smooth in x. *kappa1 >= *kappa2, positive where the solid
 * is convex, as field_curvature. */
double scaled_curvature_at(const scaled_curvature *c, vec3 x, vec3 normal, uint32_t patch, double *kappa1,
                           double *kappa2);

#endif
