// SPDX-License-Identifier: Apache-2.0
/* rounding: bounds of the rounding errors of the coordinates of a mesh. Pure functions. Results do not depend
 * on the number of threads of the pool, which may be NULL.
 */
#ifndef HEXAD_GEOMETRY_MESH_ROUNDING_H
#define HEXAD_GEOMETRY_MESH_ROUNDING_H

#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"

/* The error of a coordinate x is at most absolute + relative |x|, of which `absolute` is due to the largest coordinate of the
 * mesh. */
typedef struct rounding {
    double absolute, relative;
} rounding;

/* Estimates the error of the coordinates of a mesh. It is assumed that an affine map computed them in
 * doubles, with three products and three sums, each with an error of 2^-53 of the largest coordinate. If all
 * coordinates are representable as floats, they were then rounded to floats, with a relative error of 2^-24.
 * rounding_at_most does not test this and always includes the error of floats: an upper bound of
 * rounding_of. */
rounding rounding_of(const mesh *m, threads *pool);
rounding rounding_at_most(const mesh *m, threads *pool);

/* Largest absolute value of the coordinates, on which their rounding depends. */
double rounding_largest_coordinate(vec3 v);

/* Maximum distance of the rounded corners of a triangle from the line or plane on which their exact positions
 * lie. Each corner has an error of sqrt(3) times that of its coordinates, and the line through them has the
 * same error again. `absolute` counts at most as a millionth of the longest side, so that a part far away does not
 * flatten the others. */
double rounding_reach(const rounding *r, const vec3 corner[3]);

#endif
