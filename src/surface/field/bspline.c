// SPDX-License-Identifier: Apache-2.0
#include "surface/field/bspline.h"

#include <assert.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "surface/field/spline.h"

/* Minimum cells along the longest side of the domain; and cells per span, in which the second derivative of F
 * may change its sign once. */
static const double CELLS_COARSE = 40, CELLS_SPAN = 2;
/* In spans: tolerance for faces of boxes that are knots except for rounding. */
static const double KNOT_ROUNDING = 1e-9;

/* The index of the span at `u` spans from the low face of the domain. *t: the position within it, in [0,
 * 1]. */
static int find_span(double u, int spans, double *t)
{
    int k = (int)u;
    if (k > spans - 1) k = spans - 1; /* the high face belongs to the last span */
    *t = u - k;
    return k;
}

/* Evaluates the spline at x in the domain. The axes of `spline` are z, y, x, since x is contiguous. */
static void evaluate(const bspline *b, vec3 x, field_order order, field_sample *out)
{
    const bspline_params *p = &b->params;
    size_t row = (size_t)p->dims[0], slab = row * (size_t)p->dims[1], at[3];
    double t[3];
    for (int axis = 0; axis < 3; axis++) {
        double u = (vec3_get(x, axis) - vec3_get(p->domain.min, axis)) / vec3_get(b->span, axis);
        at[axis] = (size_t)find_span(u, p->dims[axis] - 3, &t[2 - axis]);
    }
    const double *corner = p->coefficients + at[2] * slab + at[1] * row + at[0];
    vec3 w = {1 / b->span.x, 1 / b->span.y, 1 / b->span.z};
    spline_jet j;
    if (order == FIELD_HESSIAN) {
        b->spline->hessian_wide(corner, row, slab, t, &j);
        out->hessian = (sym3){j.zz * w.x * w.x, j.yy * w.y * w.y, j.xx * w.z * w.z,
                              j.yz * w.x * w.y, j.xz * w.x * w.z, j.xy * w.y * w.z};
    } else {
        b->spline->gradient_wide(corner, row, slab, t, &j);
    }
    out->value = j.f;
    out->gradient = (vec3){j.d[2] * w.x, j.d[1] * w.y, j.d[0] * w.z};
}

static bool bspline_sample(const field *f, vec3 x, field_order order, field_sample *out)
{
    const bspline *b = (const bspline *)f;
    if (!bbox_contains(b->params.domain, x)) return false; /* NaN as well */
    evaluate(b, x, order, out);
    return true;
}

static double corner_value(const field *f, vec3 x)
{
    field_sample s;
    evaluate((const bspline *)f, x, FIELD_GRADIENT, &s);
    return s.value;
}

/* The basis functions are non-negative and add up to 1: F lies between the minimum and the maximum of the
 * coefficients that it depends on. */
static bool may_cross(const field *f, vec3 low, vec3 high)
{
    const bspline *b = (const bspline *)f;
    const bspline_params *p = &b->params;
    int first[3], last[3];
    for (int axis = 0; axis < 3; axis++) {
        double min = vec3_get(p->domain.min, axis), w = vec3_get(b->span, axis), t;
        first[axis] =
            find_span(fmax((vec3_get(low, axis) - min) / w - KNOT_ROUNDING, 0), p->dims[axis] - 3, &t);
        last[axis] = find_span((vec3_get(high, axis) - min) / w + KNOT_ROUNDING, p->dims[axis] - 3, &t) + 3;
    }
    bool inside = false, outside = false;
    for (int k = first[2]; k <= last[2]; k++)
        for (int j = first[1]; j <= last[1]; j++) {
            const double *row =
                p->coefficients + ((size_t)k * (size_t)p->dims[1] + (size_t)j) * (size_t)p->dims[0];
            for (int i = first[0]; i <= last[0]; i++) {
                inside |= row[i] < 0;
                outside |= !(row[i] < 0);
            }
            if (inside && outside) return true;
        }
    return false;
}

static const cell_grid_oracle oracle = {.value = corner_value, .may_cross = may_cross};

static size_t bspline_cell_count(const field *f)
{
    return ((const bspline *)f)->grid.count;
}

static void bspline_cell(const field *f, size_t index, field_cell *out)
{
    cell_grid_cell(&((const bspline *)f)->grid, f, &oracle, index, out);
}

static vec3 bspline_cell_middle(const field *f, size_t index, double *radius)
{
    return cell_grid_middle(&((const bspline *)f)->grid, index, radius);
}

static double bspline_side(const field *f, vec3 x)
{
    return bbox_contains(((const bspline *)f)->params.domain, x) ? 0 : 1;
}

static const field_ops bspline_ops = {.sample = bspline_sample,
                                      .cell_count = bspline_cell_count,
                                      .cell = bspline_cell,
                                      .cell_middle = bspline_cell_middle,
                                      .side = bspline_side};

/* Sets the grid: each span is divided into a whole number of cells. */
static void lay_out_grid(bspline *b)
{
    b->base.domain = b->grid.box = b->params.domain;
    b->base.extent = bbox_longest(b->base.domain);
    vec3 size = bbox_size(b->base.domain);
    for (int axis = 0; axis < 3; axis++) {
        int spans = b->params.dims[axis] - 3;
        double w = vec3_get(size, axis) / spans;
        double parts = fmax(CELLS_SPAN, ceil(w * CELLS_COARSE / b->base.extent));
        vec3_set(&b->span, axis, w);
        b->grid.cells[axis] = (int64_t)(spans * parts);
        b->base.cell_size = fmax(b->base.cell_size, w / parts);
    }
}

static size_t coefficient_count(const bspline_params *p)
{
    return (size_t)p->dims[0] * (size_t)p->dims[1] * (size_t)p->dims[2];
}

static bool no_surface(const bspline_params *p, error *e)
{
    size_t count = coefficient_count(p);
    double low = INFINITY, high = -INFINITY;
    for (size_t i = 0; i < count; i++) {
        low = fmin(low, p->coefficients[i]);
        high = fmax(high, p->coefficients[i]);
    }
    return error_set(e, ERROR_NO_SURFACE,
                     "the B-spline has no zero in its domain: give coefficients of both signs (they range "
                     "from %g to %g)",
                     low, high);
}

bspline *bspline_new(const bspline_params *params, threads *pool, error *e)
{
    bspline *b = mem_alloc(sizeof *b);
    b->spline = spline_for(params->isa);
    b->base.ops = &bspline_ops;
    b->params = *params;
    for (int axis = 0; axis < 3; axis++) assert(params->dims[axis] >= BSPLINE_LEAST_COEFFICIENTS);
    lay_out_grid(b);
    if (!cell_grid_search(&b->grid, &b->base, &oracle, pool, e)) goto fail;
    if (b->grid.count == 0) {
        no_surface(params, e);
        goto fail;
    }
    field_set_boundary(&b->base, cell_grid_cut_faces(&b->grid, &b->base, &oracle));
    return b;
fail:
    bspline_free(b);
    return NULL;
}

void bspline_free(bspline *b)
{
    if (!b) return;
    cell_grid_free(&b->grid);
    free(b);
}

size_t bspline_bytes(const bspline *b)
{
    return coefficient_count(&b->params) * sizeof *b->params.coefficients + cell_grid_bytes(&b->grid);
}
