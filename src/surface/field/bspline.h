// SPDX-License-Identifier: Apache-2.0
/* bspline: the zero set of a scalar uniform cubic B-spline in three variables, given by its coefficients.
 *
 * Along an axis with n coefficients the domain consists of n - 3 knot intervals (spans) of equal length w.
 * The basis function of coefficient i, from 0, is centred at min + (i - 1) w and is non-zero within two
 * spans. The first and the last coefficient are therefore centred one span outside the domain, and at every
 * place of the domain four basis functions per axis add up to 1:
 *     F(x, y, z) = sum c[i + nx (j + ny k)] B(u - i) B(v - j) B(w - k),  u = (x - min.x) / w.x + 1, ...
 * with B the cubic B-spline on [-2, 2]; x is fastest. F is C2, and not defined outside the domain. F < 0
 * inside. Where the zero set meets a face of the domain the surface is open. Immutable after construction,
 * any thread.
 */
#ifndef HEXAD_SURFACE_FIELD_BSPLINE_H
#define HEXAD_SURFACE_FIELD_BSPLINE_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/field/cell_grid.h"
#include "surface/field/field.h"
#include "surface/field/spline.h"

#define BSPLINE_LEAST_COEFFICIENTS 4 /* minimum along an axis: one span */

typedef struct bspline_params {
    int dims[3]; /* coefficients along x, y, z, each at least BSPLINE_LEAST_COEFFICIENTS */
    bbox domain; /* world; min < max */
    /* dims[0] * dims[1] * dims[2] finite numbers, x fastest; not owned, outlive the bspline */
    const double *coefficients;
    isa isa;
} bspline_params;

typedef struct bspline {
    field base; /* first: a bspline* is a field* */
    bspline_params params;
    vec3 span; /* w */
    const spline *spline;
    cell_grid grid;
} bspline;

/* Errors: no_surface (no cell is crossed), and those of cell_grid_search. Parts of the zero set that extend
 * less than half a span into a span may be missed. */
bspline *bspline_new(const bspline_params *params, threads *pool, error *e);
void bspline_free(bspline *b);

/* Bytes of the cells and of the coefficients, owned or not. */
size_t bspline_bytes(const bspline *b);

#endif
