// SPDX-License-Identifier: Apache-2.0
/* resolution: whether the spacing of points resolves their surface, from the points alone.
 *
 * Where two walls of the surface are closer than 1.2 spacings, the points do not determine which of them are
 * neighbours. Reason: the circumradius of a triangle of an ideal packing is 0.58 spacings. The balls with
 * this radius about the circumcentres of triangles on both walls overlap if the walls are closer than 2 *
 * 0.58 = 1.16.
 *
 * A point is unresolved if there is another point for which all of this holds (spacing: the mean of both
 * points):
 * - The distance is less than RESOLUTION_REACH spacings. The nearest point of the other wall may lie up to
 *   1.2 spacings aside, beside a hole in its packing; with a gap of 1.2 the distance is sqrt(1.2^2 + 1.2^2) =
 *   1.7.
 * - The cosine of the normals is below RESOLUTION_OPPOSITE. A crease does not count: at a right angle the
 *   normals of a spline through voxels overshoot, but the cosine remains above -0.38.
 * - One of the points is less than RESOLUTION_GAP spacings off the other's tangent plane.
 */
#ifndef HEXAD_SAMPLING_VORONOI_RESOLUTION_H
#define HEXAD_SAMPLING_VORONOI_RESOLUTION_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/bbox.h"
#include "geometry/space/vec3.h"

/* Limits of an unresolved pair, see above: the cosine of the normals, the distance and the distance from a
 * tangent plane in spacings. */
#define RESOLUTION_OPPOSITE -0.4
/* Cosine of the normals below which two walls are parallel. Walls that are not may meet in a sharp edge, near which
 * they are closer than RESOLUTION_GAP. At this angle (5.7 degrees) that is within 12 spacings of the edge. */
#define RESOLUTION_PARALLEL -0.995
#define RESOLUTION_REACH 1.7
#define RESOLUTION_GAP 1.2

typedef struct resolution_input {
    size_t count;
    const vec3 *position, *normal;
    const double *spacing; /* requested, of each; world units */
    bool open;             /* boundaries at the faces of `domain` */
    bbox domain;
    size_t every; /* sampled are the points whose index is a multiple of this; 0: all */
} resolution_input;

/* Fractions of the sampled points that are not within two spacings of a boundary; NAN: there are none. */
typedef struct resolution {
    /* points that have a Voronoi cell, are resolved, and whose Voronoi neighbours are all resolved */
    double resolved;
    double hex; /* points with six Voronoi neighbours */
} resolution;

/* Errors: limit_memory, cancelled. Deterministic for any number of threads. */
bool resolution_measure(const resolution_input *in, threads *pool, resolution *out, error *e);

#endif
