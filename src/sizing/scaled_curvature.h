/* scaled_curvature: how much a surface bends over a given distance, not at a point.
 *
 * The curvature of a field at a point is that of its smallest features: the facets of a mesh, the noise of a scan. Here
 * it is the turning of the normal over a neighbourhood: the symmetric 2 x 2 matrix S (the shape operator) that fits
 * n_j - n_i = S (x_j - x_i) best, in the tangent plane, by least squares with the weights exp(-(d / scale)^2) and with
 * the mean of both sides taken off. On a sphere of radius R it is 1/R at any scale; an edge that turns by the angle t has
 * about t / scale. Sheets that face each other do not count, nor do other patches.
 *
 * Neighbourhoods are made of elements: the mean place, normal and area of the surface in a cube, one for each of six
 * directions of the normal. World space and world units. Immutable once made, safe in any thread. */
#ifndef HEXAD_SIZING_SCALED_CURVATURE_H
#define HEXAD_SIZING_SCALED_CURVATURE_H

#include "base/error.h"
#include "base/threads.h"
#include "sizing/cell_samples.h"
#include "surface/surface.h"

typedef struct scaled_curvature scaled_curvature;

/* The least distance over which there is a curvature: a cell of the surface. */
double scaled_curvature_least(const surface *scan);

/* `sample`: those of the cells, read during the call. `scale` > 0; lesser ones than scaled_curvature_least mean that. Errors:
 * limit_memory, cancelled. Deterministic for any number of threads. */
scaled_curvature *scaled_curvature_new(const surface *scan, const cell_samples *sample, double scale,
                                       threads *pool, error *e);
void scaled_curvature_free(scaled_curvature *c);

/* The distance in force: what was asked for, or a cell. */
double scaled_curvature_scale(const scaled_curvature *c);

/* In place of a patch: all of them. */
#define SCALED_CURVATURE_ALL UINT32_MAX

/* The curvature sqrt(kappa1^2 + kappa2^2) at x, which is on the surface, or on this patch of it, and has the unit normal; a blend of the elements
 * around, smooth in x. *kappa1 >= *kappa2, positive where the solid is convex, as field_curvature gives them. */
double scaled_curvature_at(const scaled_curvature *c, vec3 x, vec3 normal, uint32_t patch, double *kappa1,
                           double *kappa2);

#endif
