/* camera: a pinhole camera and its placing before a point set. Pure functions.
 *
 * Camera space has its origin at the eye and the axes right, up, forward; depth is the third
 * coordinate. Pixel (0, 0) is the top left one, its centre at (0.5, 0.5).
 */
#ifndef HEXAD_FORMATS_CAMERA_H
#define HEXAD_FORMATS_CAMERA_H

#include <stddef.h>

#include "geometry/vec3.h"

typedef struct camera {
    vec3 origin;               /* a point of the set, world: differences to it keep their digits */
    vec3 shift;                /* from origin to the eye, along right, up, forward */
    vec3 right, up, forward;   /* unit, orthogonal */
    double focal;              /* pixels per unit of slope */
    double center_x, center_y; /* where the axis meets the picture, pixels */
} camera;

/* The part of the picture that the set must fit into, pixels. */
typedef struct camera_frame {
    double left, top, width, height;
} camera_frame;

/* Three-quarter view from above with z up: the nearest eye from which every ball (position[i],
 * radius) lies within the frame. count > 0, radius > 0; everything finite. */
camera camera_fit(const vec3 *position, size_t count, double radius, camera_frame frame);

/* World to camera space, for a point and for a direction. */
vec3 camera_point(const camera *c, vec3 world);
vec3 camera_direction(const camera *c, vec3 world);
vec3 camera_to_world(const camera *c, vec3 point);

/* The ray through a place of the picture, in camera space, with depth 1. */
static inline vec3 camera_ray(const camera *c, double x, double y)
{
    return (vec3){(x - c->center_x) / c->focal, (c->center_y - y) / c->focal, 1};
}

#endif
