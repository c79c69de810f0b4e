// SPDX-License-Identifier: Apache-2.0
/* affine: affine maps of space, as the first three rows of a 4x4 matrix for column vectors. Pure functions,
 * any thread.
 */
#ifndef HEXAD_GEOMETRY_SPACE_AFFINE_H
#define HEXAD_GEOMETRY_SPACE_AFFINE_H

#include "geometry/space/bbox.h"
#include "geometry/space/sym3.h"
#include "geometry/space/vec3.h"

static inline vec3 affine_apply(const double m[3][4], double x, double y, double z)
{
    return (vec3){m[0][0] * x + m[0][1] * y + m[0][2] * z + m[0][3],
                  m[1][0] * x + m[1][1] * y + m[1][2] * z + m[1][3],
                  m[2][0] * x + m[2][1] * y + m[2][2] * z + m[2][3]};
}

/* The image of a unit step along an axis. */
static inline vec3 affine_axis(const double m[3][4], int axis)
{
    return (vec3){m[0][axis], m[1][axis], m[2][axis]};
}

/* The bounding box of the image of a box. */
static inline bbox affine_box(const double m[3][4], bbox box)
{
    bbox out = bbox_empty();
    for (int k = 0; k < 8; k++)
        out = bbox_include(out, affine_apply(m, k & 1 ? box.max.x : box.min.x, k & 2 ? box.max.y : box.min.y,
                                             k & 4 ? box.max.z : box.min.z));
    return out;
}

/* The map that applies `inner` and then `outer`. `inner`: 16 numbers row by row, last row 0 0 0 1. */
static inline void affine_compose(const double outer[3][4], const double inner[16], double out[3][4])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 4; j++) {
            out[i][j] = outer[i][3] * inner[12 + j];
            for (int k = 0; k < 3; k++) out[i][j] += outer[i][k] * inner[4 * k + j];
        }
}

/* Aspect ratio of the image of a unit cube, 1 or more: the length of its longest edge over the least distance
 * of two opposite faces. The second differs from the shortest edge if the map shears. */
static inline double affine_aspect(const double m[3][4], const double inverse[3][4])
{
    double axes2 = 0, across2 = 0;
    for (int k = 0; k < 3; k++) {
        axes2 = fmax(axes2, m[0][k] * m[0][k] + m[1][k] * m[1][k] + m[2][k] * m[2][k]);
        across2 = fmax(across2, inverse[k][0] * inverse[k][0] + inverse[k][1] * inverse[k][1] +
                                    inverse[k][2] * inverse[k][2]);
    }
    return sqrt(axes2 * across2);
}

/* The inverse of an invertible map; returns the determinant. */
static inline double affine_invert(const double m[3][4], double out[3][4])
{
    double d[3][3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) { /* cofactors; the cyclic indices include the sign */
            int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            d[i][j] = m[i1][j1] * m[i2][j2] - m[i1][j2] * m[i2][j1];
        }
    double determinant = m[0][0] * d[0][0] + m[0][1] * d[0][1] + m[0][2] * d[0][2];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) out[i][j] = d[j][i] / determinant;
        out[i][3] = 0;
        for (int j = 0; j < 3; j++) out[i][3] -= out[i][j] * m[j][3];
    }
    return determinant;
}

/* Derivatives of f(M x) with respect to x from those of f at M x: W^T g and W^T H W, with W the linear
 * part of m. */
static inline vec3 affine_pull_gradient(const double m[3][4], vec3 g)
{
    return (vec3){m[0][0] * g.x + m[1][0] * g.y + m[2][0] * g.z,
                  m[0][1] * g.x + m[1][1] * g.y + m[2][1] * g.z,
                  m[0][2] * g.x + m[1][2] * g.y + m[2][2] * g.z};
}

static inline sym3 affine_pull_hessian(const double m[3][4], sym3 h)
{
    const vec3 a = affine_axis(m, 0), b = affine_axis(m, 1), c = affine_axis(m, 2);
    const vec3 ha = sym3_apply(h, a), hb = sym3_apply(h, b), hc = sym3_apply(h, c);
    return (sym3){vec3_dot(a, ha), vec3_dot(b, hb), vec3_dot(c, hc),
                  vec3_dot(a, hb), vec3_dot(a, hc), vec3_dot(b, hc)};
}

#endif
