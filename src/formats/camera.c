#include "formats/camera.h"

/* Half the field of view over the longer side of the frame, as a slope: about 26 degrees in all, a
 * long lens, so that the discs' sizes can be compared across the picture. */
static const double half_slope = 0.23;

/* Towards the eye: from the right, in front, above. Not on a diagonal, so that a cube shows three
 * different faces. */
static const vec3 towards_eye = {0.52, -0.74, 0.43};

static vec3 rotate(const camera *c, vec3 v)
{
    return (vec3){vec3_dot(c->right, v), vec3_dot(c->up, v), vec3_dot(c->forward, v)};
}

/* For each pair of opposite frustum planes u = +-s w the set touches, from inside, one line each;
 * the nearest eye between both is where they meet. Exact, in one pass. */
camera camera_fit(const vec3 *position, size_t count, double radius, camera_frame frame)
{
    camera c = {.forward = vec3_unit(vec3_scale(towards_eye, -1))};
    c.right = vec3_unit(vec3_cross(c.forward, vec3_make(0, 0, 1)));
    c.up = vec3_cross(c.right, c.forward);
    c.focal = 0.5 * fmax(frame.width, frame.height) / half_slope;
    c.center_x = frame.left + 0.5 * frame.width;
    c.center_y = frame.top + 0.5 * frame.height;
    double sx = 0.5 * frame.width / c.focal, sy = 0.5 * frame.height / c.focal;
    double east = -INFINITY, west = -INFINITY, north = -INFINITY, south = -INFINITY,
           nearest = INFINITY;
    c.origin = position[0];
    for (size_t i = 0; i < count; i++) {
        vec3 p = rotate(&c, vec3_sub(position[i], c.origin));
        east = fmax(east, p.x - sx * p.z);
        west = fmax(west, -p.x - sx * p.z);
        north = fmax(north, p.y - sy * p.z);
        south = fmax(south, -p.y - sy * p.z);
        nearest = fmin(nearest, p.z);
    }
    double rx = radius * sqrt(1 + sx * sx), ry = radius * sqrt(1 + sy * sy);
    double x = 0.5 * (east - west), y = 0.5 * (north - south);
    double back = fmax((0.5 * (east + west) + rx) / sx, (0.5 * (north + south) + ry) / sy);
    double z = fmin(-back, nearest - 2 * radius); /* no ball may reach the eye */
    c.shift = vec3_make(x, y, z);
    return c;
}

vec3 camera_point(const camera *c, vec3 world)
{
    return vec3_sub(rotate(c, vec3_sub(world, c->origin)), c->shift);
}

vec3 camera_direction(const camera *c, vec3 world)
{
    return rotate(c, world);
}

vec3 camera_to_world(const camera *c, vec3 p)
{
    p = vec3_add(p, c->shift);
    return vec3_axpy(p.x, c->right, vec3_axpy(p.y, c->up, vec3_axpy(p.z, c->forward, c->origin)));
}
