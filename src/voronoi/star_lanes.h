/* star_lanes: planar stars (voronoi.h) of several points at once, one point in each SIMD lane. The result is the same to the last bit as
 * one after the other, in 0.6 of the time.
 *
 * A planar star is computed from the polygon that the bisectors bound in the tangent plane of the point. Distances are those in space.
 * On a sphere the edges of the polygon are therefore those of the diagram in space. On other surfaces they differ by terms of second order
 * in the bend of the surface within the lists, which STAR_MIN_COSINE and STAR_MAX_SLOPE bound. The neighbours equal those of
 * voronoi_star_triangles if every edge of the polygon is longer than STAR_MIN_EDGE, and every other point would have to come nearer by as
 * much to get an edge. Otherwise the planar star is not used. World space. Pure functions, any thread.
 */
#ifndef HEXAD_VORONOI_STAR_LANES_H
#define HEXAD_VORONOI_STAR_LANES_H

#include <math.h>
#include <stdint.h>

#include "voronoi/voronoi.h"

/* Minimum cosine between the normal of the point and those of its list. */
#define STAR_MIN_COSINE 0.9
/* Maximum height of a listed point over the tangent plane, divided by its distance: the sine of half of that angle. */
#define STAR_MAX_SLOPE 0.22
/* Points whose normals have a smaller cosine are on opposite walls, whatever the other normals of the list are: VORONOI_OPPOSITE_COSINE
 * less half of the angle of STAR_MIN_COSINE. */
#define STAR_OPPOSITE_COSINE -0.77
/* Minimum length of an edge of a planar star, in spacings. With this value no planar star of the tests' sets differs from that by triangles. */
#define STAR_MIN_EDGE 0.225
/* Distance of the points that are tried first, in spacings: mostly the neighbours alone. */
#define STAR_RING_FIRST 1.45

enum { STAR_LANES = 4, STAR_LIST_MAX = 32 };

/* The neighbour lists of up to STAR_LANES points, entry by entry. */
typedef struct star_lists {
    uint32_t most; /* length of the longest list */
    uint32_t point[STAR_LANES], count[STAR_LANES];
    /* Per entry: its position relative to the point, its normal (turned towards the point's if its sign is arbitrary) and its spacing.
     * Values beyond the end of a list are undefined. */
    double x[STAR_LIST_MAX][STAR_LANES], y[STAR_LIST_MAX][STAR_LANES], z[STAR_LIST_MAX][STAR_LANES];
    double nx[STAR_LIST_MAX][STAR_LANES], ny[STAR_LIST_MAX][STAR_LANES], nz[STAR_LIST_MAX][STAR_LANES];
    double spacing[STAR_LIST_MAX][STAR_LANES];
    /* the cosine between the two normals, and the squared distance */
    double facing[STAR_LIST_MAX][STAR_LANES], square[STAR_LIST_MAX][STAR_LANES];
} star_lists;

/* One number, or one condition (all bits set: true), per lane; for functions marked ISA_CLONES. */
typedef double lane_values __attribute__((vector_size(8 * STAR_LANES), aligned(8), may_alias));
typedef int64_t lane_mask __attribute__((vector_size(8 * STAR_LANES), aligned(8), may_alias));

/* Per lane: a where `which` is set, else b. ALL: the same number in all lanes. (Macros, because functions with and without AVX pass
 * vectors differently.) */
#define CHOOSE(which, a, b) ((lane_values)(((lane_mask)(a) & (which)) | ((lane_mask)(b) & ~(which))))
#define ALL(number) ((lane_values){0} + (number))

/* Computes the stars of `count` points, at most STAR_LANES, as voronoi_star_at does. *lists is zeroed, or left by another call. False:
 * a list is longer than STAR_LIST_MAX; *lists is undefined, *out is complete. */
bool star_lanes_at(const voronoi_sites *sites, const uint32_t *points, uint32_t count, star_lists *lists,
                   voronoi_star *out);

#endif
