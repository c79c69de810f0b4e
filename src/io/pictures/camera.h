// SPDX-License-Identifier: Apache-2.0
/* camera: a pinhole or orthographic camera, and its placement in front of a point set. Pure functions.
 *
 * Camera space has its origin at the eye and the axes right, up, forward; depth is the third coordinate.
 * Pixel (0, 0) is the top left one, its centre is at (0.5, 0.5).
 */
#ifndef HEXAD_IO_PICTURES_CAMERA_H
#define HEXAD_IO_PICTURES_CAMERA_H

#include <stdbool.h>
#include <stddef.h>

#include "geometry/space/vec3.h"

typedef struct camera {
    vec3 origin;               /* a place near the set, world: differences from it lose no digits */
    vec3 shift;                /* from origin to the eye, along right, up, forward */
    vec3 right, up, forward;   /* unit, orthogonal */
    bool parallel;             /* orthographic: all rays are parallel */
    double focal;              /* pixels per unit of slope; parallel: per world unit */
    double center_x, center_y; /* intersection of the axis with the picture, pixels */
} camera;

/* Position of a camera, as a job specifies it. */
typedef struct camera_place {
    vec3 position, target, up; /* world; `up` is not parallel to the line of sight */
    double fov;  /* field of view along the longer side of the picture, radians; 0: that of camera_fit */
    double span; /* orthographic: world units along the longer side; 0: pinhole */
} camera_place;

/* The part of the picture that the set must fit into, pixels. */
typedef struct camera_frame {
    double left, top, width, height;
    bool y_up; /* y, not z, points up */
} camera_frame;

/* Three-quarter view from above with z (or y) up, from the closest eye from which every ball (position[i],
 * radius) lies within the frame. An elongated set that would be seen end-on is seen from a direction rotated
 * by 90 degrees. count > 0, radius > 0 (world units); all values finite. */
camera camera_fit(const vec3 *position, size_t count, double radius, camera_frame frame);

/* Cameras as in camera_fit from `frames` eyes on a circle around the vertical axis through the centre of the
 * set, at the largest distance that any of them needs; one turn counterclockwise seen from above. `out` has
 * `frames` elements. */
void camera_orbit(const vec3 *position, size_t count, double radius, camera_frame frame, int frames,
                  camera *out);

/* The camera at a place; its axis meets the centre of the picture. Sizes in pixels. */
camera camera_look(const camera_place *place, int width, int height);

/* The place rotated by an angle (radians, counterclockwise from above) about the axis `up` through its
 * target. */
camera_place camera_turn(const camera_place *place, double angle);

/* World to camera space, for a direction and for a point. */
static inline vec3 camera_direction(const camera *c, vec3 world)
{
    return (vec3){vec3_dot(c->right, world), vec3_dot(c->up, world), vec3_dot(c->forward, world)};
}

static inline vec3 camera_point(const camera *c, vec3 world)
{
    return vec3_sub(camera_direction(c, vec3_sub(world, c->origin)), c->shift);
}

vec3 camera_to_world(const camera *c, vec3 point);

/* Pixels per world unit at a depth. */
static inline double camera_scale(const camera *c, double depth)
{
    return c->parallel ? c->focal : c->focal / depth;
}

/* Projects a point in camera space to the picture, pixels. */
static inline void camera_project(const camera *c, vec3 point, double *x, double *y)
{
    double scale = camera_scale(c, point.z);
    *x = c->center_x + scale * point.x;
    *y = c->center_y - scale * point.y;
}

/* The viewing direction at a point in camera space, not normalised. */
static inline vec3 camera_sight(const camera *c, vec3 point)
{
    return c->parallel ? (vec3){0, 0, 1} : point;
}

/* The ray through a place of the picture, in camera space, with depth 1: from the eye; orthographic: its
 * right and up coordinates at any depth. */
static inline vec3 camera_ray(const camera *c, double x, double y)
{
    return (vec3){(x - c->center_x) / c->focal, (c->center_y - y) / c->focal, 1};
}

#endif
