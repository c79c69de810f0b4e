// SPDX-License-Identifier: Apache-2.0
/* smooth_triangle: a triangle with normals at its corners that are interpolated over it, and the projection
 * of places onto it, for one place or for several in SIMD lanes with the same bits. Pure functions, any
 * thread.
 */
#ifndef HEXAD_GEOMETRY_SPACE_SMOOTH_TRIANGLE_H
#define HEXAD_GEOMETRY_SPACE_SMOOTH_TRIANGLE_H

#include <math.h>

#include "base/core/isa.h"
#include "geometry/space/vec3.h"

/* If the distance of a place's projection from every edge is at least this multiple of its distance from the
 * plane, no other triangle is closer. Exception: another triangle is folded over this one by more than 150
 * degrees. */
enum { SMOOTH_TRIANGLE_MARGIN = 2 };
/* Minimum |cosine| between the interpolated normal and the normal of the triangle; smaller values are
 * clamped. |grad F| is at most its inverse. */
#define SMOOTH_TRIANGLE_MIN_COSINE 0.25

/* Corners and unit normals at them, all on one side of the surface. */
typedef struct smooth_triangle {
    vec3 corner[3], normal[3];
} smooth_triangle;

/* n or -n, whichever is on the side of `of`. */
ISA_INLINE vec3 smooth_triangle_turn(vec3 n, vec3 of)
{
    const double sign = vec3_dot(n, of) < 0 ? -1 : 1;
    return vec3_scale(n, sign);
}

/* > 0 if a place of this barycentric weight is SMOOTH_TRIANGLE_MARGIN times as far from the edge `side`,
 * opposite to the corner, as from the plane. `cross2`: squared length of the cross product of two edges.
 * `up`: distance from the plane times the length of that product. */
ISA_INLINE double smooth_triangle_margin(double weight, double cross2, double up, vec3 side)
{
    const double within = weight * cross2;
    return weight > 0 ? within * within -
                            SMOOTH_TRIANGLE_MARGIN * SMOOTH_TRIANGLE_MARGIN * up * up * vec3_norm2(side)
                      : -1;
}

/* Barycentric weights of the projection of x onto the plane of the triangle. Returns a value > 0 if the
 * projection lies inside the triangle by SMOOTH_TRIANGLE_MARGIN. (Without loops and booleans, which would
 * prevent vectorisation.) */
ISA_INLINE double smooth_triangle_weights(const smooth_triangle *t, vec3 x, double weight[3])
{
    const vec3 off = vec3_sub(x, t->corner[0]), ab = vec3_sub(t->corner[1], t->corner[0]),
               bc = vec3_sub(t->corner[2], t->corner[1]), ca = vec3_sub(t->corner[0], t->corner[2]),
               cross = vec3_cross(ab, bc);
    const double cross2 = vec3_norm2(cross), up = vec3_dot(off, cross);
    weight[1] = vec3_dot(vec3_cross(ca, off), cross) / cross2;
    weight[2] = vec3_dot(vec3_cross(ab, off), cross) / cross2;
    weight[0] = 1 - weight[1] - weight[2];
    const double room[3] = {smooth_triangle_margin(weight[0], cross2, up, bc),
                            smooth_triangle_margin(weight[1], cross2, up, ca),
                            smooth_triangle_margin(weight[2], cross2, up, ab)},
                 two = room[0] > 0 ? room[1] : -1;
    return two > 0 ? room[2] : -1;
}

/* The normal of the triangle: unit, or zero without area. */
ISA_INLINE vec3 smooth_triangle_own_normal(const smooth_triangle *t)
{
    return vec3_unit(vec3_cross(vec3_sub(t->corner[1], t->corner[0]), vec3_sub(t->corner[2], t->corner[0])));
}

/* The offset of x from the place of these weights, and the interpolated normal there, not normalised. */
ISA_INLINE vec3 smooth_triangle_offset(const smooth_triangle *t, const double weight[3], vec3 x, vec3 *normal)
{
    const vec3 none = {0, 0, 0}, *c = t->corner, *n = t->normal;
    *normal = vec3_axpy(weight[2], n[2], vec3_axpy(weight[1], n[1], vec3_axpy(weight[0], n[0], none)));
    return vec3_sub(x,
                    vec3_axpy(weight[2], c[2], vec3_axpy(weight[1], c[1], vec3_axpy(weight[0], c[0], none))));
}

/* Signed distance along the interpolated `normal` to the plane with the normal `own`. A triangle in a small
 * fold may face away from the interpolated normal. */
ISA_INLINE double smooth_triangle_distance(vec3 off, vec3 normal, vec3 own)
{
    const double facing = vec3_dot(normal, own), size = fabs(facing),
                 least = size > SMOOTH_TRIANGLE_MIN_COSINE ? size : SMOOTH_TRIANGLE_MIN_COSINE;
    return vec3_dot(off, own) / (facing < 0 ? -least : least);
}

/* Several places, each with its own triangle. */
typedef struct smooth_triangle_lanes {
    vec3_lanes corner[3], normal[3], x;
    /* Results of smooth_triangle_find_lanes. above: result of smooth_triangle_weights. If it is > 0: the
     * distance and the unit normal. */
    double above[VEC3_LANES], value[VEC3_LANES];
    vec3_lanes unit;
} smooth_triangle_lanes;

void smooth_triangle_find_lanes(smooth_triangle_lanes *f);

#endif
