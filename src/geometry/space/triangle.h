// SPDX-License-Identifier: Apache-2.0
/* triangle: distance of a point from a triangle, and subdivision of a triangle. Pure functions, any
 * thread. */
#ifndef HEXAD_GEOMETRY_SPACE_TRIANGLE_H
#define HEXAD_GEOMETRY_SPACE_TRIANGLE_H

#include <stdbool.h>
#include <stdint.h>

#include "geometry/space/bbox.h"
#include "geometry/space/vec3.h"

typedef struct triangle {
    vec3 a, b, c;
} triangle;

static inline triangle triangle_of_corners(const vec3 *vertex, const uint32_t corner[3])
{
    return (triangle){vertex[corner[0]], vertex[corner[1]], vertex[corner[2]]};
}

static inline bbox triangle_box(const triangle *t)
{
    return bbox_include(bbox_include(bbox_include(bbox_empty(), t->a), t->b), t->c);
}

/* The squared distance of p from the triangle, by the region of the projected point: corner, edge or face. A
 * triangle without area has no face region. Source: Ericson 2005, "Real-Time Collision Detection", 5.1.5. */
double triangle_distance2(const triangle *t, vec3 p);

/* The barycentric weights, with the sum 1, of the point of the triangle that is nearest to p. */
void triangle_weights(const triangle *t, vec3 p, double weight[3]);

/* The point of the triangle that is nearest to p. */
vec3 triangle_nearest(const triangle *t, vec3 p);

/* Splits a triangle at the midpoints of the sides in `halved`, preserving the orientation. Returns the number
 * of parts, 1 to 4. In `parts`, 0 to 2 are the corners of the triangle, and 3 + k is the midpoint of the side
 * from corner k to the next one. */
int triangle_split(const bool halved[3], int parts[4][3]);

#endif
