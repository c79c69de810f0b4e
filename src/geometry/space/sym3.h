// SPDX-License-Identifier: Apache-2.0
/* sym3: a symmetric 3x3 matrix. Pure functions, any thread. */
#ifndef HEXAD_GEOMETRY_SPACE_SYM3_H
#define HEXAD_GEOMETRY_SPACE_SYM3_H

#include "geometry/space/vec3.h"

typedef struct sym3 {
    double xx, yy, zz, xy, xz, yz;
} sym3;

static inline vec3 sym3_apply(sym3 m, vec3 v)
{
    return (vec3){m.xx * v.x + m.xy * v.y + m.xz * v.z, m.xy * v.x + m.yy * v.y + m.yz * v.z,
                  m.xz * v.x + m.yz * v.y + m.zz * v.z};
}

/* Solves m x = b by elimination; m is positive definite. */
static inline vec3 sym3_solve(sym3 m, vec3 b)
{
    double l21 = m.xy / m.xx, l31 = m.xz / m.xx;
    double yy = m.yy - l21 * m.xy, yz = m.yz - l31 * m.xy, zz = m.zz - l31 * m.xz;
    double by = b.y - l21 * b.x, bz = b.z - l31 * b.x, l32 = yz / yy;
    vec3 x;
    x.z = (bz - l32 * by) / (zz - l32 * yz);
    x.y = (by - yz * x.z) / yy;
    x.x = (b.x - m.xy * x.y - m.xz * x.z) / m.xx;
    return x;
}

/* The eigenvalues of the 2x2 matrix ((a, b), (b, c)), *high >= *low. */
static inline void sym2_eigenvalues(double a, double b, double c, double *high, double *low)
{
    double mean = 0.5 * (a + c), half = 0.5 * (a - c), radius = sqrt(half * half + b * b);
    *high = mean + radius;
    *low = mean - radius;
}

#endif
