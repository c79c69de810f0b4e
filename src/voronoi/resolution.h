/* resolution: whether the spacing of points resolves their surface, from the points alone.
 *
 * Where two walls of the surface are closer than 1.2 spacings, the points do not determine which of them are neighbours: the
 * circumradius of a triangle of an ideal packing is 0.58 spacings, and two such balls on the two walls touch. A point is unresolved if
 * another point is within 1.7 spacings (the mean of both; beside a hole of 1.2 in the other wall), the cosine of their normals is below
 * -0.4, and either point is less than 1.2 spacings off the other's tangent plane. At a crease of right angle the cosine of a spline's
 * normals is above -0.38.
 */
#ifndef HEXAD_VORONOI_RESOLUTION_H
#define HEXAD_VORONOI_RESOLUTION_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/bbox.h"
#include "geometry/vec3.h"

/* Limits of an unresolved pair, see above: the cosine of the normals, the distance and the distance from a tangent plane in spacings. */
#define RESOLUTION_OPPOSITE -0.4
#define RESOLUTION_REACH 1.7
#define RESOLUTION_GAP 1.2

typedef struct resolution_input {
    size_t count;
    const vec3 *position, *normal;
    const double *spacing; /* requested, of each; world units */
    bool open;             /* boundaries at the faces of `domain` */
    bbox domain;
    size_t every; /* one of this number of points is sampled; 0: all */
} resolution_input;

/* Fractions of the sampled points that are not within two spacings of a boundary; NAN: there are none. */
typedef struct resolution {
    double resolved; /* points with a Voronoi cell that are resolved, as are their Voronoi neighbours */
    double hex;      /* points with six Voronoi neighbours */
} resolution;

/* Errors: limit_memory, cancelled. Deterministic for any number of threads. */
bool resolution_measure(const resolution_input *in, threads *pool, resolution *out, error *e);

#endif
