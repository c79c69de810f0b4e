/* camera: a camera, pinhole or parallel, and its placing before a point set. Pure functions.
 *
 * Camera space has its origin at the eye and the axes right, up, forward; depth is the third
 * coordinate. Pixel (0, 0) is the top left one, its centre at (0.5, 0.5).
 */
#ifndef HEXAD_FORMATS_CAMERA_H
#define HEXAD_FORMATS_CAMERA_H

#include <stdbool.h>
#include <stddef.h>

#include "geometry/vec3.h"

typedef struct camera {
    vec3 origin;               /* a place at or in the set, world: differences to it keep their digits */
    vec3 shift;                /* from origin to the eye, along right, up, forward */
    vec3 right, up, forward;   /* unit, orthogonal */
    bool parallel;             /* all rays are: an orthographic picture */
    double focal;              /* pixels per unit of slope; parallel: per world unit */
    double center_x, center_y; /* where the axis meets the picture, pixels */
} camera;

/* A camera as it is asked for. */
typedef struct camera_place {
    vec3 position, target, up; /* world; `up` is not parallel to the line of sight */
    double fov;                /* along the picture's longer side, radians; 0: that of camera_fit */
    double span;               /* parallel: world units along the longer side; 0: a pinhole */
} camera_place;

/* The part of the picture that the set must fit into, pixels. */
typedef struct camera_frame {
    double left, top, width, height;
    bool y_up; /* the set stands along y, not z */
} camera_frame;

/* Three-quarter view from above with z (or y) up: the nearest eye from which every ball (position[i],
 * radius) lies within the frame. A long set that would be seen from its end is seen from a quarter
 * further round. count > 0, radius > 0; everything finite. */
camera camera_fit(const vec3 *position, size_t count, double radius, camera_frame frame);

/* The same from `frames` eyes around the axis that is up through the middle of the set, all as far away as the
 * farthest has to be, one turn counterclockwise seen from above; `out` has room for them. */
void camera_orbit(const vec3 *position, size_t count, double radius, camera_frame frame, int frames,
                  camera *out);

/* The camera at a place, its axis in the middle of the picture. */
camera camera_look(const camera_place *place, int width, int height);

/* The place turned by an angle (radians, counterclockwise from above) about its `up` through its target. */
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

/* Where a point in camera space is in the picture, pixels. */
static inline void camera_project(const camera *c, vec3 point, double *x, double *y)
{
    double scale = camera_scale(c, point.z);
    *x = c->center_x + scale * point.x;
    *y = c->center_y - scale * point.y;
}

/* The way that a point in camera space is looked at, not a unit vector. */
static inline vec3 camera_sight(const camera *c, vec3 point)
{
    return c->parallel ? (vec3){0, 0, 1} : point;
}

/* The ray through a place of the picture, in camera space, with depth 1: from the eye; parallel: what it
 * has for right and up at any depth. */
static inline vec3 camera_ray(const camera *c, double x, double y)
{
    return (vec3){(x - c->center_x) / c->focal, (c->center_y - y) / c->focal, 1};
}

#endif
