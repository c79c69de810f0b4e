// SPDX-License-Identifier: Apache-2.0
/* triangle_filter: discards triangles of a point and its neighbours that cannot be triangles of the surface
 * (voronoi.h), in single precision for many triangles at once. Conservative: no triangle that voronoi.c would
 * accept is discarded. On a density volume, voronoi.c accepts four of five of the remaining triangles.
 * Lengths are world units. Pure functions, any thread.
 */
#ifndef HEXAD_SAMPLING_VORONOI_TRIANGLE_FILTER_H
#define HEXAD_SAMPLING_VORONOI_TRIANGLE_FILTER_H

#include "sampling/voronoi/voronoi.h"

/* Maximum circumradius in spacings. A larger triangle spans a hole or a boundary. An ideal triangle has 0.58;
 * beside a vacancy it is 1. */
#define TRIANGLE_MAX_CIRCUMRADIUS 1.5
/* The Voronoi line of a triangle (the places with equal distances from its corners) is tested at least up to
 * this distance from the circumcentre in both directions, in spacings. */
#define TRIANGLE_MIN_DEPTH 0.5

/* A point and its neighbours, nearest first. */
typedef struct triangle_filter_input {
    uint32_t count; /* neighbours, at most VORONOI_STAR_MAX */
    vec3 at, normal;
    double spacing;
    const double *x, *y, *z, *nx, *ny, *nz, *other; /* per neighbour: position, normal, spacing */
    /* per neighbour: lower bound of the squared distance of it and of all later ones. It is not the distance,
     * because voronoi.c displaces the points slightly after it has sorted them. */
    const double *square;
} triangle_filter_input;

/* The neighbours relative to the point, over its spacing. */
typedef struct triangle_filter {
    uint32_t count;
    float x[VORONOI_STAR_MAX], y[VORONOI_STAR_MAX], z[VORONOI_STAR_MAX];
    float nx[VORONOI_STAR_MAX], ny[VORONOI_STAR_MAX], nz[VORONOI_STAR_MAX];
    float widest[VORONOI_STAR_MAX]; /* twice the maximum circumradius of a triangle with it */
    float finest[VORONOI_STAR_MAX]; /* the smaller of the two spacings */
    float square[VORONOI_STAR_MAX];
    /* loose: margin for rounding; squared circumradii are decreased by this */
    float own_nx, own_ny, own_nz, loose;
} triangle_filter;

void triangle_filter_fill(const triangle_filter_input *input, triangle_filter *out);

/* Filters the triangles of the point, its neighbour `at` and each of `count` third corners (indices of
 * neighbours other than `at`). The indices of those that may be triangles of the surface are moved to the
 * front of `third`, in their order. Returns their number. by[k]: for each of these the neighbours that clip
 * the low end (by[k][0]) and the high end of its Voronoi line most; -1: none does. The line points from low
 * to high in the direction of the cross product of the edges from the point to `at` and to the third
 * corner. This is an estimate: another neighbour may clip slightly more. */
uint32_t triangle_filter_third_corners(const triangle_filter *s, uint32_t at, uint32_t count,
                                       uint32_t third[VORONOI_STAR_MAX], int32_t by[VORONOI_STAR_MAX][2]);

#endif
