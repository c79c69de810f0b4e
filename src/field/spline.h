/* spline: uniform cubic B-splines in three variables, evaluated in one cell of their grid.
 *
 * A cell of the grid has 4^3 coefficients: `corner` is the one of lowest index along every axis, the third
 * axis is contiguous, and `row` and `slab` are the steps to the next along the second and the first. In
 * axis k the point stands at t[k] in [0, 1] of the way from the node of the second coefficient to that of
 * the third. C2 across cells. Pure functions, safe in any thread.
 * Source: Unser 1999, "Splines: A Perfect Fit for Signal and Image Processing", box 2.
 */
#ifndef HEXAD_FIELD_SPLINE_H
#define HEXAD_FIELD_SPLINE_H

#include <stddef.h>

#include "base/isa.h"
#include "geometry/vec3.h"

/* A value with its derivatives along the grid's axes, per cell. */
typedef struct spline_jet {
    double f;
    double d[3]; /* along the first, second, third axis */
    double xx, yy, zz, xy, xz, yz;
} spline_jet;

/* Places in cells of their own, and what `gradient_lanes` makes of them. */
typedef struct spline_lanes {
    const float *corner[VEC3_LANES]; /* NULL: none, all is 0 there */
    float t[3][VEC3_LANES];
    float f[VEC3_LANES], d[3][VEC3_LANES]; /* as in spline_jet */
} spline_lanes;

/* The functions for one instruction set; the results are the same to the last bit with any. `gradient` leaves
 * the second derivatives untouched. */
typedef struct spline {
    void (*gradient)(const float *corner, size_t row, size_t slab, const double t[3], spline_jet *out);
    void (*hessian)(const float *corner, size_t row, size_t slab, const double t[3], spline_jet *out);
    /* in single precision */
    void (*gradient_lanes)(spline_lanes *lanes, size_t row, size_t slab);
    /* the same as the first two for coefficients in doubles */
    void (*gradient_wide)(const double *corner, size_t row, size_t slab, const double t[3], spline_jet *out);
    void (*hessian_wide)(const double *corner, size_t row, size_t slab, const double t[3], spline_jet *out);
} spline;

const spline *spline_for(isa which);

#endif
