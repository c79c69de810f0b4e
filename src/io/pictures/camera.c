// SPDX-License-Identifier: Apache-2.0
#include "io/pictures/camera.h"

#include "base/core/compare.h"
#include "base/core/elementary.h"
#include "geometry/space/bbox.h"

/* Half the field of view over the longer side of the frame, as a slope: about 26 degrees in total. With a
 * long focal length the sizes of discs are comparable across the picture. */
static const double half_slope = 0.23;

/* Direction to the eye: from the right, front and above; not diagonal, so that a cube shows three
 * different faces. */
static const vec3 towards_eye = {0.52, -0.74, 0.43};

/* A set is elongated along the line of sight if its variance along it exceeds END_ON times that along both
 * axes of the picture; the eye is then rotated by 90 degrees. Smaller: also rotates for sets that are
 * shown well. */
static const double END_ON = 2;

static vec3 turn_about(vec3 v, vec3 axis, double angle)
{
    vec3 along = vec3_scale(axis, vec3_dot(v, axis)), across = vec3_sub(v, along);
    return vec3_axpy(elementary_sin(angle), vec3_cross(axis, across),
                     vec3_axpy(elementary_cos(angle), across, along));
}

/* A pinhole camera centred in a frame that looks against `towards_eye`, rotated about the vertical axis by an
 * angle; its position is not set. */
static camera aim(double angle, camera_frame frame)
{
    vec3 up = frame.y_up ? vec3_make(0, 1, 0) : vec3_make(0, 0, 1), e = towards_eye;
    if (frame.y_up) e = vec3_make(e.x, e.z, -e.y);
    camera c = {.forward = vec3_unit(vec3_scale(turn_about(e, up, angle), -1))};
    c.right = vec3_unit(vec3_cross(c.forward, up));
    c.up = vec3_cross(c.right, c.forward);
    c.focal = 0.5 * fmax(frame.width, frame.height) / half_slope;
    c.center_x = frame.left + 0.5 * frame.width;
    c.center_y = frame.top + 0.5 * frame.height;
    return c;
}

/* The angle of the still camera: 0 unless the set would be seen end-on. */
static double front_angle(const vec3 *position, size_t count, camera_frame frame)
{
    const camera c = aim(0, frame);
    vec3 sum = {0, 0, 0}, squares = {0, 0, 0};
    for (size_t i = 0; i < count; i++) {
        const vec3 p = camera_direction(&c, vec3_sub(position[i], position[0]));
        sum = vec3_add(sum, p);
        squares = vec3_add(squares, vec3_make(p.x * p.x, p.y * p.y, p.z * p.z));
    }
    const vec3 mean = vec3_scale(sum, 1 / (double)count), square = vec3_scale(squares, 1 / (double)count);
    const double across = fmax(square.x - mean.x * mean.x, square.y - mean.y * mean.y);
    return square.z - mean.z * mean.z > END_ON * across ? M_PI / 2 : 0;
}

/* Bounds of a set for a frustum: for the opposite planes u = +-s w, the extreme values of the set. */
typedef struct frustum_bounds {
    double sx, sy; /* slopes of the planes */
    double east, west, north, south, nearest;
} frustum_bounds;

static frustum_bounds touch_set(const camera *c, const vec3 *position, size_t count, camera_frame frame)
{
    frustum_bounds t = {.sx = 0.5 * frame.width / c->focal, .sy = 0.5 * frame.height / c->focal};
    t.east = t.west = t.north = t.south = -INFINITY;
    t.nearest = INFINITY;
    for (size_t i = 0; i < count; i++) {
        vec3 p = camera_direction(c, vec3_sub(position[i], c->origin));
        t.east = compare_larger(t.east, p.x - t.sx * p.z);
        t.west = compare_larger(t.west, -p.x - t.sx * p.z);
        t.north = compare_larger(t.north, p.y - t.sy * p.z);
        t.south = compare_larger(t.south, -p.y - t.sy * p.z);
        t.nearest = compare_smaller(t.nearest, p.z);
    }
    return t;
}

/* The closest eye is the intersection of both pairs of planes. Exact, in one pass. */
camera camera_fit(const vec3 *position, size_t count, double radius, camera_frame frame)
{
    camera c = aim(front_angle(position, count, frame), frame);
    c.origin = position[0];
    frustum_bounds t = touch_set(&c, position, count, frame);
    double rx = radius * sqrt(1 + t.sx * t.sx), ry = radius * sqrt(1 + t.sy * t.sy);
    double x = 0.5 * (t.east - t.west), y = 0.5 * (t.north - t.south);
    double back = fmax((0.5 * (t.east + t.west) + rx) / t.sx, (0.5 * (t.north + t.south) + ry) / t.sy);
    double z = fmin(-back, t.nearest - 2 * radius); /* the eye is outside all balls */
    c.shift = vec3_make(x, y, z);
    return c;
}

void camera_orbit(const vec3 *position, size_t count, double radius, camera_frame frame, int frames,
                  camera *out)
{
    const bbox box = bbox_of_points(position, count, NULL);
    const double front = front_angle(position, count, frame);
    double z = 0;
    for (int k = 0; k < frames; k++) {
        camera c = aim(front + 2 * M_PI * k / frames, frame);
        c.origin = vec3_scale(vec3_add(box.min, box.max), 0.5);
        frustum_bounds t = touch_set(&c, position, count, frame);
        double rx = radius * sqrt(1 + t.sx * t.sx), ry = radius * sqrt(1 + t.sy * t.sy);
        double back = fmax((fmax(t.east, t.west) + rx) / t.sx, (fmax(t.north, t.south) + ry) / t.sy);
        z = fmin(z, fmin(-back, t.nearest - 2 * radius));
        out[k] = c;
    }
    for (int k = 0; k < frames; k++) out[k].shift = vec3_make(0, 0, z);
}

camera camera_look(const camera_place *place, int width, int height)
{
    camera c = {.origin = place->target, .parallel = place->span > 0};
    double longer = fmax(width, height),
           slope = place->fov > 0 ? elementary_tan(0.5 * place->fov) : half_slope;
    c.forward = vec3_unit(vec3_sub(place->target, place->position));
    c.right = vec3_unit(vec3_cross(c.forward, place->up));
    c.up = vec3_cross(c.right, c.forward);
    c.shift = camera_direction(&c, vec3_sub(place->position, place->target));
    c.focal = c.parallel ? longer / place->span : 0.5 * longer / slope;
    c.center_x = 0.5 * width;
    c.center_y = 0.5 * height;
    return c;
}

camera_place camera_turn(const camera_place *place, double angle)
{
    camera_place turned = *place;
    vec3 away = vec3_sub(place->position, place->target);
    turned.position = vec3_add(place->target, turn_about(away, vec3_unit(place->up), angle));
    return turned;
}

vec3 camera_to_world(const camera *c, vec3 p)
{
    p = vec3_add(p, c->shift);
    return vec3_axpy(p.x, c->right, vec3_axpy(p.y, c->up, vec3_axpy(p.z, c->forward, c->origin)));
}
