// SPDX-License-Identifier: Apache-2.0
#include "io/points/quaternion.h"

#include "base/core/elementary.h"

void quaternion_of_normal(vec3 normal, double twist, double out[4])
{
    const double side = elementary_hypot(normal.x, normal.y), half = 0.5 * elementary_atan2(side, normal.z);
    /* the shortest rotation is about z x normal, which has no z component */
    const double x = elementary_sin(half) * (side > 0 ? -normal.y / side : 1),
                 y = elementary_sin(half) * (side > 0 ? normal.x / side : 0), w = elementary_cos(half),
                 s = elementary_sin(0.5 * twist), c = elementary_cos(0.5 * twist), sign = w * c < 0 ? -1 : 1;
    const double product[4] = {x * c + y * s, y * c - x * s, w * s, w * c};
    for (int k = 0; k < 4; k++) out[k] = product[k] == 0 ? 0 : sign * product[k];
}

vec3 quaternion_rotate(const double q[4], vec3 x)
{
    const vec3 v = {q[0], q[1], q[2]}, t = vec3_scale(vec3_cross(v, x), 2);
    return vec3_add(vec3_axpy(q[3], t, x), vec3_cross(v, t));
}

double quaternion_twist_along(vec3 normal, vec3 along)
{
    double q[4];
    quaternion_of_normal(normal, 0, q);
    const double x = vec3_dot(along, quaternion_rotate(q, vec3_make(1, 0, 0))),
                 y = vec3_dot(along, quaternion_rotate(q, vec3_make(0, 1, 0)));
    return x == 0 && y == 0 ? 0 : elementary_atan2(y, x);
}
