/* bspline: the zero set of a scalar uniform cubic B-spline in three variables, by its coefficients.
 *
 * Along an axis with n coefficients the domain is n - 3 spans of equal length w, each a knot interval;
 * coefficient i, from 0, belongs to the basis function that is centred on min + (i - 1) w and reaches two
 * spans to either side. So the first and the last coefficient stand one span outside of the domain, and at
 * every point of it four basis functions an axis add up to 1:
 *     F(x, y, z) = sum c[i + nx (j + ny k)] B(u - i) B(v - j) B(w - k),  u = (x - min.x) / w.x + 1, ...
 * with B the cubic B-spline on [-2, 2]; x is fastest. F is C2 and is not defined outside of the domain. F < 0
 * inside, as everywhere; where the zero set meets a face of the domain the surface is open there.
 */
#ifndef HEXAD_FIELD_BSPLINE_H
#define HEXAD_FIELD_BSPLINE_H

#include "base/error.h"
#include "base/threads.h"
#include "field/cell_grid.h"
#include "field/field.h"
#include "field/spline.h"

#define BSPLINE_LEAST_COEFFICIENTS 4 /* along an axis: one span */

typedef struct bspline_params {
    int dims[3]; /* coefficients along x, y, z, each at least BSPLINE_LEAST_COEFFICIENTS */
    bbox domain; /* world; min < max */
    const double
        *coefficients; /* dims[0] dims[1] dims[2] of them, finite, x fastest; not owned, outlive it */
    isa isa;
} bspline_params;

typedef struct bspline {
    field base; /* first: a bspline* is a field* */
    bspline_params params;
    vec3 span; /* w */
    const spline *spline;
    cell_grid grid;
} bspline;

/* Errors: no_surface when no cell is crossed, and those of cell_grid_search. Zeros that reach
 * into a span by less than half of it may go unnoticed. */
bspline *bspline_new(const bspline_params *params, threads *pool, error *e);
void bspline_free(bspline *b);

/* Bytes of the cells and of the coefficients, whoever holds these. */
size_t bspline_bytes(const bspline *b);

#endif
