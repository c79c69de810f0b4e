// SPDX-License-Identifier: Apache-2.0
/* vec3: vectors of three doubles, passed by value, and arrays of sixteen vectors for kernels. Units are the
 * caller's. Pure functions, any thread.
 */
#ifndef HEXAD_GEOMETRY_SPACE_VEC3_H
#define HEXAD_GEOMETRY_SPACE_VEC3_H

#include <math.h>

typedef struct vec3 {
    double x, y, z;
} vec3;

/* The number of vectors that a kernel processes together. */
enum { VEC3_LANES = 16 };

typedef struct vec3_lanes {
    double x[VEC3_LANES], y[VEC3_LANES], z[VEC3_LANES];
} vec3_lanes;

static inline vec3 vec3_lanes_get(const vec3_lanes *v, int lane)
{
    return (vec3){v->x[lane], v->y[lane], v->z[lane]};
}

static inline void vec3_lanes_put(vec3_lanes *v, int lane, vec3 x)
{
    v->x[lane] = x.x;
    v->y[lane] = x.y;
    v->z[lane] = x.z;
}

static inline vec3 vec3_make(double x, double y, double z)
{
    return (vec3){x, y, z};
}
static inline vec3 vec3_add(vec3 a, vec3 b)
{
    return (vec3){a.x + b.x, a.y + b.y, a.z + b.z};
}
static inline vec3 vec3_sub(vec3 a, vec3 b)
{
    return (vec3){a.x - b.x, a.y - b.y, a.z - b.z};
}
static inline vec3 vec3_scale(vec3 a, double s)
{
    return (vec3){a.x * s, a.y * s, a.z * s};
}
static inline double vec3_dot(vec3 a, vec3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
static inline double vec3_norm2(vec3 a)
{
    return vec3_dot(a, a);
}
static inline double vec3_norm(vec3 a)
{
    return sqrt(vec3_norm2(a));
}

/* a + s b */
static inline vec3 vec3_axpy(double s, vec3 b, vec3 a)
{
    return (vec3){a.x + s * b.x, a.y + s * b.y, a.z + s * b.z};
}

static inline vec3 vec3_cross(vec3 a, vec3 b)
{
    return (vec3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/* (b - a) x (c - a): the normal of the triangle a, b, c, as long as twice its area. */
static inline vec3 vec3_across(vec3 a, vec3 b, vec3 c)
{
    return vec3_cross(vec3_sub(b, a), vec3_sub(c, a));
}

/* a / |a|; the zero vector for the zero vector */
static inline vec3 vec3_unit(vec3 a)
{
    double n = vec3_norm(a);
    return n > 0 ? vec3_scale(a, 1 / n) : (vec3){0, 0, 0};
}

static inline double vec3_get(vec3 a, int axis)
{
    return axis == 0 ? a.x : axis == 1 ? a.y : a.z;
}
static inline void vec3_set(vec3 *a, int axis, double v)
{
    *(axis == 0 ? &a->x : axis == 1 ? &a->y : &a->z) = v;
}

/* Compares by x, then by y, then by z. Returns a value < 0, 0 or > 0, as qsort requires. 0 and -0 are
 * equal. */
static inline int vec3_compare(vec3 a, vec3 b)
{
    for (int axis = 0; axis < 3; axis++) {
        double x = vec3_get(a, axis), y = vec3_get(b, axis);
        if (x != y) return x < y ? -1 : 1;
    }
    return 0;
}

/* Two unit vectors that form a right-handed frame with the unit vector n. Source: Duff et al. 2017, "Building
 * an Orthonormal Basis, Revisited", JCGT 6(1). */
static inline void vec3_frame(vec3 n, vec3 *u, vec3 *v)
{
    double sign = copysign(1.0, n.z), a = -1.0 / (sign + n.z), b = n.x * n.y * a;
    *u = (vec3){1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x};
    *v = (vec3){b, sign + n.y * n.y * a, -n.y};
}

#endif
