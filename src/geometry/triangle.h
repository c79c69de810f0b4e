/* triangle: the distance of a point from a triangle, and its parts when sides are halved. */
#ifndef HEXAD_GEOMETRY_TRIANGLE_H
#define HEXAD_GEOMETRY_TRIANGLE_H

#include <stdbool.h>

#include "geometry/bbox.h"
#include "geometry/vec3.h"

typedef struct triangle {
    vec3 a, b, c;
} triangle;

static inline bbox triangle_box(const triangle *t)
{
    return bbox_include(bbox_include(bbox_include(bbox_empty(), t->a), t->b), t->c);
}

/* Square of the distance. By the region that contains the projected point: corner, edge or face; a triangle
 * without area has no face. Source: Ericson 2005, "Real-Time Collision Detection", 5.1.5. */
double triangle_distance2(const triangle *t, vec3 p);

/* The weights of the corners, which add up to 1, at the place of the triangle that is nearest to p. */
void triangle_weights(const triangle *t, vec3 p, double weight[3]);

/* That place. */
vec3 triangle_nearest(const triangle *t, vec3 p);

/* Splits a triangle at the middles of its halved sides, keeping its orientation. Returns the number of parts, 1 to 4.
 * Corners 0 to 2 are the triangle's, 3 + k is the middle of the side from corner k to the next. */
int triangle_split(const bool halved[3], int parts[4][3]);

#endif
