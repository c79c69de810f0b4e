/* foot: the place of a triangle that is below a place, and the distance from it, for one place or for several side by side, with the
 * same bits. Pure functions.
 */
#ifndef HEXAD_GEOMETRY_FOOT_H
#define HEXAD_GEOMETRY_FOOT_H

#include <math.h>

#include "base/isa.h"
#include "geometry/vec3.h"

/* A place this many times as far within the sides of a triangle as from it is nearest to that one, unless others are folded
 * over it by more than 150 degrees. */
enum { FOOT_ROOM = 2 };
/* Least |cosine| between the interpolated normal and the triangle's own that is used: |grad F| is at most its inverse. */
#define FOOT_LEAST_FACING 0.25

/* A triangle's corners, and the normals there, unit, all on one side of the surface. */
typedef struct foot_triangle {
    vec3 corner[3], normal[3];
} foot_triangle;

/* `n`, or its reverse, whichever is on the side of `of`. */
ISA_INLINE vec3 foot_facing(vec3 n, vec3 of)
{
    const double sign = vec3_dot(n, of) < 0 ? -1 : 1;
    return vec3_scale(n, sign);
}

/* Above 0 where a place of this weight, `up` high, is FOOT_ROOM times as far from the side opposite of the corner as it is high; `up`
 * times, and `cross2` the square of, the length of the sides' cross product. */
ISA_INLINE double foot_room(double weight, double cross2, double up, vec3 side)
{
    const double within = weight * cross2;
    return weight > 0 ? within * within - FOOT_ROOM * FOOT_ROOM * up * up * vec3_norm2(side) : -1;
}

/* The weights of the corners where x is above the plane of the triangle. Above 0 where x is above the triangle itself, and so near to it
 * that nothing beyond its sides can be nearer. (Neither loops nor truth values: with them the compiler does not take lanes
 * together.) */
ISA_INLINE double foot_weights(const foot_triangle *t, vec3 x, double weight[3])
{
    const vec3 off = vec3_sub(x, t->corner[0]), ab = vec3_sub(t->corner[1], t->corner[0]),
               bc = vec3_sub(t->corner[2], t->corner[1]), ca = vec3_sub(t->corner[0], t->corner[2]),
               cross = vec3_cross(ab, bc);
    const double cross2 = vec3_norm2(cross), up = vec3_dot(off, cross);
    weight[1] = vec3_dot(vec3_cross(ca, off), cross) / cross2;
    weight[2] = vec3_dot(vec3_cross(ab, off), cross) / cross2;
    weight[0] = 1 - weight[1] - weight[2];
    const double room[3] = {foot_room(weight[0], cross2, up, bc), foot_room(weight[1], cross2, up, ca),
                            foot_room(weight[2], cross2, up, ab)},
                 two = room[0] > 0 ? room[1] : -1;
    return two > 0 ? room[2] : -1;
}

/* The triangle's own normal, unit or zero. */
ISA_INLINE vec3 foot_own_normal(const foot_triangle *t)
{
    return vec3_unit(vec3_cross(vec3_sub(t->corner[1], t->corner[0]), vec3_sub(t->corner[2], t->corner[0])));
}

/* From the place of these weights to x, and the sum of the corners' normals. */
ISA_INLINE vec3 foot_off(const foot_triangle *t, const double weight[3], vec3 x, vec3 *normal)
{
    const vec3 none = {0, 0, 0}, *c = t->corner, *n = t->normal;
    *normal = vec3_axpy(weight[2], n[2], vec3_axpy(weight[1], n[1], vec3_axpy(weight[0], n[0], none)));
    return vec3_sub(x,
                    vec3_axpy(weight[2], c[2], vec3_axpy(weight[1], c[1], vec3_axpy(weight[0], c[0], none))));
}

/* Along the normal to the plane of the triangle. A triangle in a small fold may face away from the normal. */
ISA_INLINE double foot_distance(vec3 off, vec3 normal, vec3 own)
{
    const double facing = vec3_dot(normal, own), size = fabs(facing),
                 least = size > FOOT_LEAST_FACING ? size : FOOT_LEAST_FACING;
    return vec3_dot(off, own) / (facing < 0 ? -least : least);
}

/* Several places, each with a triangle of its own. */
typedef struct foot_lanes {
    vec3_lanes corner[3], normal[3], x;
    /* what foot_find_lanes tells: above 0 where foot_weights finds x above the triangle; and there the distance, and the normal */
    double above[VEC3_LANES], value[VEC3_LANES];
    vec3_lanes unit;
} foot_lanes;

void foot_find_lanes(foot_lanes *f);

#endif
