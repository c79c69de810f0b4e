// SPDX-License-Identifier: Apache-2.0
/* spline: evaluates uniform cubic B-splines in three variables in one cell of their grid.
 *
 * A cell has 4^3 coefficients: `corner` points to the one with the lowest index along every axis, the third
 * axis is contiguous, and `row` and `slab` are the strides of the second and the first axis. Along axis k the
 * place is at the fraction t[k], in [0, 1], between the nodes of the second and the third coefficient. C2
 * across cells. Pure functions, any thread. Source: Unser 1999, "Splines: A Perfect Fit for Signal and Image
 * Processing", box 2.
 */
#ifndef HEXAD_SURFACE_FIELD_SPLINE_H
#define HEXAD_SURFACE_FIELD_SPLINE_H

#include <stddef.h>

#include "base/core/isa.h"
#include "geometry/space/vec3.h"

/* A value with its derivatives along the grid's axes, per cell. */
typedef struct spline_jet {
    double f;
    double d[3]; /* along the first, second, third axis */
    double xx, yy, zz, xy, xz, yz;
} spline_jet;

/* Input and output of `gradient_lanes`: one place per lane, each in its own cell. */
typedef struct spline_lanes {
    const float *corner[VEC3_LANES]; /* NULL: no place; all outputs are 0 */
    float t[3][VEC3_LANES];
    float f[VEC3_LANES], d[3][VEC3_LANES]; /* as in spline_jet */
} spline_lanes;

/* The functions for one instruction set; the results of all sets are bitwise equal. `gradient` does not write
 * the second derivatives. */
typedef struct spline {
    void (*gradient)(const float *corner, size_t row, size_t slab, const double t[3], spline_jet *out);
    void (*hessian)(const float *corner, size_t row, size_t slab, const double t[3], spline_jet *out);
    /* in single precision */
    void (*gradient_lanes)(spline_lanes *lanes, size_t row, size_t slab);
    /* the first two functions for coefficients in doubles */
    void (*gradient_wide)(const double *corner, size_t row, size_t slab, const double t[3], spline_jet *out);
    void (*hessian_wide)(const double *corner, size_t row, size_t slab, const double t[3], spline_jet *out);
} spline;

const spline *spline_for(isa which);

#endif
