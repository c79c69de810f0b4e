// SPDX-License-Identifier: Apache-2.0
#include "surface/field/analytic.h"

#include <stdlib.h>

#include "base/core/elementary.h"
#include "base/core/isa.h"
#include "base/core/memory.h"

/* Cells along the longest side of the domain, and across the smallest feature of the shape. The error of the
 * area of the quartic of (15) is 1e-6; more cells only cost time. */
static const double CELLS_COARSE = 32, CELLS_FEATURE = 6;
/* Sharp edges are cut off within a cell: 0.1 % of the area of a cube with this many cells along its side. */
static const double CELLS_SHARP = 160;
/* Maximum along an axis; more than any search accepts. */
static const double MOST_CELLS = 0x1p40;
/* Extension of the lateral surface of a frustum, in its lengths and radii. */
static const double FARTHER = 10;

/* F and its gradient for each shape. False where they are not defined. Mostly without branches, so that the
 * compiler vectorises them. */
ISA_INLINE bool sample_sphere(const analytic_params *p, vec3 d, field_order order, field_sample *out)
{
    double length = vec3_norm(d);
    vec3 n = vec3_scale(d, 1 / length);
    out->value = length - p->radius;
    out->gradient = n;
    if (order == FIELD_HESSIAN) {
        double k = 1 / length;
        out->hessian = (sym3){k * (1 - n.x * n.x), k * (1 - n.y * n.y), k * (1 - n.z * n.z),
                              -k * n.x * n.y,      -k * n.x * n.z,      -k * n.y * n.z};
    }
    return length > 0;
}

ISA_INLINE bool sample_torus(const analytic_params *p, vec3 d, field_order order, field_sample *out)
{
    vec3 a = p->axis;
    double z = vec3_dot(d, a);
    vec3 q = vec3_axpy(-z, a, d);
    double rho = vec3_norm(q), u = rho - p->major_radius, length = sqrt(u * u + z * z);
    double over = 1 / length;
    vec3 e = vec3_scale(q, 1 / rho);
    vec3 n = vec3_add(vec3_scale(e, u * over), vec3_scale(a, z * over));
    out->value = length - p->minor_radius;
    out->gradient = n;
    if (order == FIELD_HESSIAN) {
        /* curvature of the tube along t = n x (a x e), and of the sweep along w = a x e */
        vec3 w = vec3_cross(a, e), t = vec3_cross(n, w);
        double kt = 1 / length, kw = u / (length * rho);
        out->hessian = (sym3){kt * t.x * t.x + kw * w.x * w.x, kt * t.y * t.y + kw * w.y * w.y,
                              kt * t.z * t.z + kw * w.z * w.z, kt * t.x * t.y + kw * w.x * w.y,
                              kt * t.x * t.z + kw * w.x * w.z, kt * t.y * t.z + kw * w.y * w.z};
    }
    return (rho > 0) & (length > 0);
}

/* A core box grown by `rounding`: the distance from the core minus the rounding. */
ISA_INLINE bool sample_box(const analytic_params *p, vec3 d, field_order order, field_sample *out)
{
    vec3 core = vec3_sub(p->half_size, vec3_make(p->rounding, p->rounding, p->rounding));
    vec3 q = {fabs(d.x) - core.x, fabs(d.y) - core.y, fabs(d.z) - core.z};
    vec3 sign = {copysign(1, d.x), copysign(1, d.y), copysign(1, d.z)};
    vec3 m = {fmax(q.x, 0), fmax(q.y, 0), fmax(q.z, 0)};
    double length = vec3_norm(m);
    sym3 hessian = {0};
    if (length > 0) {
        vec3 n = vec3_scale((vec3){m.x * sign.x, m.y * sign.y, m.z * sign.z}, 1 / length);
        double k = 1 / length;
        out->value = length - p->rounding;
        out->gradient = n;
        hessian = (sym3){k * ((q.x > 0) - n.x * n.x),
                         k * ((q.y > 0) - n.y * n.y),
                         k * ((q.z > 0) - n.z * n.z),
                         -k * n.x * n.y,
                         -k * n.x * n.z,
                         -k * n.y * n.z};
    } else {
        int axis = q.x >= q.y && q.x >= q.z ? 0 : q.y >= q.z ? 1 : 2;
        out->value = vec3_get(q, axis) - p->rounding;
        out->gradient = (vec3){0, 0, 0};
        vec3_set(&out->gradient, axis, vec3_get(sign, axis));
    }
    if (order == FIELD_HESSIAN) out->hessian = hessian;
    return true;
}

/* (|x / radii|^2 - 1) times half the smallest radius: near the surface this approximates the distance. */
ISA_INLINE bool sample_ellipsoid(const analytic_params *p, vec3 d, field_order order, field_sample *out)
{
    vec3 w = {1 / (p->radii.x * p->radii.x), 1 / (p->radii.y * p->radii.y), 1 / (p->radii.z * p->radii.z)};
    double scale = 0.5 * fmin(p->radii.x, fmin(p->radii.y, p->radii.z));
    out->value = scale * (w.x * d.x * d.x + w.y * d.y * d.y + w.z * d.z * d.z - 1);
    out->gradient = (vec3){2 * scale * w.x * d.x, 2 * scale * w.y * d.y, 2 * scale * w.z * d.z};
    if (order == FIELD_HESSIAN)
        out->hessian = (sym3){2 * scale * w.x, 2 * scale * w.y, 2 * scale * w.z, 0, 0, 0};
    return true;
}

/* (15): sum x^4 - 10 r^2 sum x^2. The centre is a degenerate zero with no gradient. */
ISA_INLINE bool sample_quartic(const analytic_params *p, vec3 d, field_order order, field_sample *out)
{
    double c = 10 * p->r * p->r;
    vec3 s = {d.x * d.x, d.y * d.y, d.z * d.z};
    out->value = s.x * s.x + s.y * s.y + s.z * s.z - c * (s.x + s.y + s.z);
    out->gradient = (vec3){(4 * s.x - 2 * c) * d.x, (4 * s.y - 2 * c) * d.y, (4 * s.z - 2 * c) * d.z};
    if (order == FIELD_HESSIAN)
        out->hessian = (sym3){12 * s.x - 2 * c, 12 * s.y - 2 * c, 12 * s.z - 2 * c, 0, 0, 0};
    return true;
}

/* sin X cos Y + sin Y cos Z + sin Z cos X with X = 2 pi x / period */
ISA_INLINE bool sample_gyroid(const analytic_params *p, vec3 d, field_order order, field_sample *out)
{
    double k = 2 * M_PI / p->period;
    const elementary_sines x = elementary_sincos(k * d.x), y = elementary_sincos(k * d.y),
                           z = elementary_sincos(k * d.z);
    out->value = x.sin * y.cos + y.sin * z.cos + z.sin * x.cos;
    out->gradient = (vec3){k * (x.cos * y.cos - z.sin * x.sin), k * (y.cos * z.cos - x.sin * y.sin),
                           k * (z.cos * x.cos - y.sin * z.sin)};
    if (order == FIELD_HESSIAN) {
        double kk = k * k;
        out->hessian = (sym3){-kk * (x.sin * y.cos + z.sin * x.cos),
                              -kk * (y.sin * z.cos + x.sin * y.cos),
                              -kk * (z.sin * x.cos + y.sin * z.cos),
                              -kk * x.cos * y.sin,
                              -kk * z.cos * x.sin,
                              -kk * y.cos * z.sin};
    }
    return true;
}

/* In a half-plane through the axis a frustum is a convex polygon: the distance from it, and its gradient. */
typedef struct section {
    double value, along_radius, along_axis, bend; /* bend: curvature in the half-plane */
} section;

ISA_INLINE section sample_section(const analytic_frustum *f, double rho, double z)
{
    double rise = f->top - f->bottom, widening = f->top_radius - f->bottom_radius;
    double length = sqrt(rise * rise + widening * widening);
    /* normal of the lateral side */
    double nr = length > 0 ? rise / length : 1, nz = length > 0 ? -widening / length : 0;
    double below = f->bottom - z, above = z - f->top, u = rho - f->bottom_radius;
    double beside = u * nr - below * nz, along = -u * nz - below * nr;
    bool inside = fmax(beside, fmax(below, above)) <= 0;
    if (inside ? beside >= below && beside >= above : beside > 0 && along >= 0 && along <= length)
        return (section){beside, nr, nz, 0};
    if (inside ? below >= above : below > 0 && rho <= f->bottom_radius) return (section){below, 0, -1, 0};
    if (inside || (above > 0 && rho <= f->top_radius)) return (section){above, 0, 1, 0};
    bool low = along < 0.5 * length; /* which rim is closest */
    double r = rho - (low ? f->bottom_radius : f->top_radius), s = z - (low ? f->bottom : f->top);
    double far = sqrt(r * r + s * s);
    return far > 0 ? (section){far, r / far, s / far, 1 / far} : (section){0, nr, nz, 0};
}

ISA_INLINE bool sample_frustum(const analytic_params *p, vec3 d, field_order order, field_sample *out)
{
    vec3 a = p->axis, e, unused;
    double z = vec3_dot(d, a);
    vec3 q = vec3_axpy(-z, a, d);
    double rho = vec3_norm(q);
    if (rho > 0)
        e = vec3_scale(q, 1 / rho);
    else
        vec3_frame(a, &e, &unused);
    section s = sample_section(&p->core, rho, z);
    out->value = s.value - p->rounding;
    out->gradient = vec3_add(vec3_scale(e, s.along_radius), vec3_scale(a, s.along_axis));
    if (order == FIELD_HESSIAN) {
        /* along t in the half-plane, and around the axis along w */
        vec3 w = vec3_cross(a, e), t = vec3_cross(out->gradient, w);
        double kt = s.bend, kw = rho > 0 ? s.along_radius / rho : s.bend;
        out->hessian = (sym3){kt * t.x * t.x + kw * w.x * w.x, kt * t.y * t.y + kw * w.y * w.y,
                              kt * t.z * t.z + kw * w.z * w.z, kt * t.x * t.y + kw * w.x * w.y,
                              kt * t.x * t.z + kw * w.x * w.z, kt * t.y * t.z + kw * w.y * w.z};
    }
    return true;
}

ISA_INLINE bool sample_halfspace(const analytic_params *p, vec3 d, field_order order, field_sample *out)
{
    out->value = vec3_dot(d, p->axis);
    out->gradient = p->axis;
    if (order == FIELD_HESSIAN) out->hessian = (sym3){0};
    return true;
}

static bool analytic_sample(const field *f, vec3 x, field_order order, field_sample *out)
{
    const analytic_params *p = &((const analytic *)f)->params;
    const vec3 d = vec3_sub(x, p->center);
    field_sample s;
    bool defined = false;
    switch (p->shape) {
    case ANALYTIC_SPHERE:
        defined = sample_sphere(p, d, order, &s);
        break;
    case ANALYTIC_TORUS:
        defined = sample_torus(p, d, order, &s);
        break;
    case ANALYTIC_BOX:
        defined = sample_box(p, d, order, &s);
        break;
    case ANALYTIC_ELLIPSOID:
        defined = sample_ellipsoid(p, d, order, &s);
        break;
    case ANALYTIC_QUARTIC:
        defined = sample_quartic(p, d, order, &s);
        break;
    case ANALYTIC_GYROID:
        defined = sample_gyroid(p, d, order, &s);
        break;
    case ANALYTIC_FRUSTUM:
        defined = sample_frustum(p, d, order, &s);
        break;
    case ANALYTIC_HALFSPACE:
        defined = sample_halfspace(p, d, order, &s);
        break;
    }
    if (!defined) return false;
    out->value = s.value;
    out->gradient = s.gradient;
    if (order == FIELD_HESSIAN) out->hessian = s.hessian;
    return true;
}

/* The compiler vectorises loops over numbers of one type in arrays that do not overlap. */
#define LANES(shape)                                                                                        \
    ISA_CLONES static void shape##_lanes(const analytic_params *restrict p, const vec3_lanes *restrict x,   \
                                         bool *defined, double *restrict value, vec3_lanes *restrict slope) \
    {                                                                                                       \
        double good[VEC3_LANES];                                                                            \
        for (int l = 0; l < VEC3_LANES; l++) {                                                              \
            const vec3 d = vec3_sub(vec3_lanes_get(x, l), p->center);                                       \
            field_sample s;                                                                                 \
            good[l] = sample_##shape(p, d, FIELD_GRADIENT, &s) ? 1.0 : 0.0;                                 \
            value[l] = s.value;                                                                             \
            vec3_lanes_put(slope, l, s.gradient);                                                           \
        }                                                                                                   \
        for (int l = 0; l < VEC3_LANES; l++) defined[l] &= good[l] > 0;                                     \
    }
LANES(sphere)
LANES(torus)
LANES(box)
LANES(ellipsoid)
LANES(quartic)
LANES(gyroid)
LANES(frustum)
LANES(halfspace)

/* In double precision, as `sample`. */
static void analytic_sample_lanes(const field *f, const vec3_lanes *x, bool *defined, double *value,
                                  vec3_lanes *gradient)
{
    static void (*const lanes_of[])(const analytic_params *, const vec3_lanes *, bool *, double *,
                                    vec3_lanes *) = {
        [ANALYTIC_SPHERE] = sphere_lanes,   [ANALYTIC_TORUS] = torus_lanes,
        [ANALYTIC_BOX] = box_lanes,         [ANALYTIC_ELLIPSOID] = ellipsoid_lanes,
        [ANALYTIC_QUARTIC] = quartic_lanes, [ANALYTIC_GYROID] = gyroid_lanes,
        [ANALYTIC_FRUSTUM] = frustum_lanes, [ANALYTIC_HALFSPACE] = halfspace_lanes};
    const analytic_params *p = &((const analytic *)f)->params;
    lanes_of[p->shape](p, x, defined, value, gradient);
}

/* The side at a point without a derivative: the centre of a sphere or of the tube of a torus is inside, the
 * axis of a torus outside. */
static double corner_value(const field *f, vec3 x)
{
    const analytic_params *p = &((const analytic *)f)->params;
    field_sample s;
    if (analytic_sample(f, x, FIELD_GRADIENT, &s)) return s.value;
    return p->shape == ANALYTIC_TORUS ? p->major_radius - p->minor_radius : -1;
}

static void corner_values(const field *f, const vec3_lanes *x, double value[VEC3_LANES])
{
    bool defined[VEC3_LANES];
    vec3_lanes gradient;
    for (int l = 0; l < VEC3_LANES; l++) defined[l] = true;
    analytic_sample_lanes(f, x, defined, value, &gradient);
    for (int l = 0; l < VEC3_LANES; l++)
        if (!defined[l]) value[l] = corner_value(f, vec3_lanes_get(x, l));
}

/* An upper bound of the second derivatives within `radius` of a point, in any direction. */
static double bend_bound(const analytic_params *p, vec3 d, double radius)
{
    double far = vec3_norm(d) + radius, k = 2 * M_PI / p->period, c = 10 * p->r * p->r;
    double thin = fmin(p->radii.x, fmin(p->radii.y, p->radii.z));
    switch (p->shape) {
    case ANALYTIC_ELLIPSOID:
        return 1 / thin;
    case ANALYTIC_QUARTIC:
        return 12 * far * far + 2 * c;
    case ANALYTIC_GYROID:
        return 3 * k * k;
    default:
        return 0;
    }
}

/* Whether F may be zero in the box. Distances have slope 1; others are bounded by a Taylor expansion. */
static bool may_cross(const field *f, vec3 low, vec3 high)
{
    const analytic_params *p = &((const analytic *)f)->params;
    field_sample s;
    vec3 half = vec3_scale(vec3_sub(high, low), 0.5), middle = vec3_add(low, half);
    double radius = vec3_norm(half);
    if (!analytic_sample(f, middle, FIELD_GRADIENT, &s)) return true;
    double bend = bend_bound(p, vec3_sub(middle, p->center), radius);
    double slope = bend > 0 ? vec3_norm(s.gradient) + 0.5 * bend * radius : 1;
    return fabs(s.value) <= slope * radius * (1 + 1e-9);
}

static const cell_grid_oracle oracle = {corner_value, corner_values, may_cross};

static size_t analytic_cell_count(const field *f)
{
    return ((const analytic *)f)->grid.count;
}

static void analytic_cell(const field *f, size_t index, field_cell *out)
{
    cell_grid_cell(&((const analytic *)f)->grid, f, &oracle, index, out);
}

static vec3 analytic_cell_middle(const field *f, size_t index, double *radius)
{
    return cell_grid_middle(&((const analytic *)f)->grid, index, radius);
}

/* The formula is valid everywhere except at isolated points. */
static double analytic_side(const field *f, vec3 x)
{
    field_sample s;
    return analytic_sample(f, x, FIELD_GRADIENT, &s) ? 0 : corner_value(f, x);
}

static const field_ops analytic_ops = {.sample = analytic_sample,
                                       .cell_count = analytic_cell_count,
                                       .cell = analytic_cell,
                                       .cell_middle = analytic_cell_middle,
                                       .side = analytic_side,
                                       .sample_lanes = analytic_sample_lanes};

static vec3 half_extent(const analytic_params *p)
{
    vec3 n = p->axis;
    double quartic = 0.5 * p->r / 0.13, R = p->major_radius, m = p->minor_radius;
    switch (p->shape) {
    case ANALYTIC_SPHERE:
        return vec3_make(p->radius, p->radius, p->radius);
    case ANALYTIC_TORUS: /* a circle of radius R about n extends R sqrt(1 - n_k^2) along axis k */
        return vec3_make(R * sqrt(fmax(0, 1 - n.x * n.x)) + m, R * sqrt(fmax(0, 1 - n.y * n.y)) + m,
                         R * sqrt(fmax(0, 1 - n.z * n.z)) + m);
    case ANALYTIC_BOX:
        return p->half_size;
    case ANALYTIC_ELLIPSOID:
        return p->radii;
    case ANALYTIC_QUARTIC:
        return vec3_make(quartic, quartic, quartic);
    case ANALYTIC_GYROID:
        return vec3_scale(p->size, 0.5);
    case ANALYTIC_FRUSTUM:
        R = fmax(p->core.bottom_radius, p->core.top_radius) + p->rounding;
        m = fmax(-p->core.bottom, p->core.top) + p->rounding;
        return vec3_make(R * sqrt(fmax(0, 1 - n.x * n.x)) + m * fabs(n.x),
                         R * sqrt(fmax(0, 1 - n.y * n.y)) + m * fabs(n.y),
                         R * sqrt(fmax(0, 1 - n.z * n.z)) + m * fabs(n.z));
    case ANALYTIC_HALFSPACE:
        break;
    }
    return (vec3){0, 0, 0};
}

/* The maximum cell size that resolves the shape. */
static double cell_bound(const analytic_params *p)
{
    double thin = fmin(p->half_size.x, fmin(p->half_size.y, p->half_size.z));
    double box = fmax(p->half_size.x, fmax(p->half_size.y, p->half_size.z));
    double round = fmin(p->radii.x, fmin(p->radii.y, p->radii.z));
    double longest = fmax(p->radii.x, fmax(p->radii.y, p->radii.z)), tip = round * round / longest;
    switch (p->shape) {
    case ANALYTIC_TORUS:
        return fmin(p->minor_radius, p->major_radius - p->minor_radius) / CELLS_FEATURE;
    case ANALYTIC_BOX: /* resolves the rounding, unless that would need more than CELLS_SHARP cells */
        return fmin(thin / CELLS_FEATURE, fmax(p->rounding / CELLS_FEATURE * 2, 2 * box / CELLS_SHARP));
    case ANALYTIC_ELLIPSOID: /* resolves the sharpest end, within the same limit */
        return fmin(round / CELLS_FEATURE, fmax(tip / CELLS_FEATURE, 2 * longest / CELLS_SHARP));
    case ANALYTIC_GYROID:
        return p->period / (4 * CELLS_FEATURE);
    case ANALYTIC_FRUSTUM: /* as a box */
        round = fmax(p->core.bottom_radius, p->core.top_radius) + p->rounding;
        box = 0.5 * (p->core.top - p->core.bottom) + p->rounding;
        return fmin(fmin(round, box) / CELLS_FEATURE,
                    fmax(p->rounding / CELLS_FEATURE * 2, 2 * fmax(round, box) / CELLS_SHARP));
    default:
        return INFINITY;
    }
}

static void lay_out_grid(analytic *a)
{
    const analytic_params *p = &a->params;
    vec3 half = half_extent(p);
    bool open = p->shape == ANALYTIC_GYROID;
    /* A closed surface must not touch the faces. An odd margin keeps the zeros of symmetric shapes off the
     * corners. */
    double margin = open || p->shape == ANALYTIC_QUARTIC ? 1 : 1.0317;
    half = vec3_scale(half, margin);
    a->base.domain = p->shape == ANALYTIC_HALFSPACE
                         ? p->bounds
                         : (bbox){vec3_sub(p->center, half), vec3_add(p->center, half)};
    field_set_boundary(&a->base, open ? FIELD_ALL_FACES : 0);
    a->base.extent = bbox_longest(a->base.domain);
    a->base.cell_size = fmin(a->base.extent / CELLS_COARSE, cell_bound(p));
    a->base.sharp = (p->shape == ANALYTIC_BOX || p->shape == ANALYTIC_FRUSTUM) && p->rounding == 0;
    a->base.joined = !open && p->shape != ANALYTIC_QUARTIC; /* its centre is a zero, too */
    a->grid.box = a->base.domain;
    vec3 size = bbox_size(a->base.domain);
    for (int axis = 0; axis < 3; axis++)
        a->grid.cells[axis] = (int64_t)fmin(ceil(vec3_get(size, axis) / a->base.cell_size), MOST_CELLS);
}

static analytic_params plane_of(vec3 at, vec3 out_of)
{
    return (analytic_params){.shape = ANALYTIC_HALFSPACE, .center = at, .axis = out_of};
}

static int box_pieces(const analytic_params *p, analytic_params *out)
{
    for (int k = 0; k < 6; k++) {
        double sign = k & 1 ? 1 : -1;
        vec3 normal = {0, 0, 0};
        vec3_set(&normal, k >> 1, sign);
        out[k] = plane_of(vec3_axpy(vec3_get(p->half_size, k >> 1), normal, p->center), normal);
    }
    return 6;
}

/* The lateral surface comes first. It is extended to its apex or by `reach`, so that its ends are never the
 * closest place. */
static int frustum_pieces(const analytic_params *p, analytic_params *out)
{
    vec3 axis = vec3_unit(p->axis);
    const analytic_frustum *c = &p->core;
    double slope = (c->top_radius - c->bottom_radius) / (c->top - c->bottom);
    double reach = FARTHER * (c->top - c->bottom + c->bottom_radius + c->top_radius) * (1 + fabs(slope));
    double down = slope > 0 ? fmin(c->bottom_radius / slope, reach) : reach;
    double up = slope < 0 ? fmin(-c->top_radius / slope, reach) : reach;
    int count = 1;
    out[0] = *p;
    out[0].core = (analytic_frustum){c->bottom - down, c->top + up, fmax(c->bottom_radius - slope * down, 0),
                                     fmax(c->top_radius + slope * up, 0)};
    if (c->bottom_radius > 0)
        out[count++] = plane_of(vec3_axpy(c->bottom, axis, p->center), vec3_scale(axis, -1));
    if (c->top_radius > 0) out[count++] = plane_of(vec3_axpy(c->top, axis, p->center), axis);
    return count;
}

int analytic_pieces(const analytic_params *shape, analytic_params out[ANALYTIC_PIECES])
{
    if (shape->rounding == 0 && shape->shape == ANALYTIC_BOX) return box_pieces(shape, out);
    if (shape->rounding == 0 && shape->shape == ANALYTIC_FRUSTUM) return frustum_pieces(shape, out);
    out[0] = *shape;
    return 1;
}

analytic *analytic_new_piece(const analytic_params *params)
{
    analytic *a = mem_alloc(sizeof *a);
    a->base.ops = &analytic_ops;
    a->params = *params;
    a->params.axis = vec3_unit(params->axis);
    return a;
}

analytic *analytic_new(const analytic_params *params, threads *pool, error *e)
{
    analytic *a = mem_alloc(sizeof *a);
    a->base.ops = &analytic_ops;
    a->params = *params;
    a->params.axis = vec3_unit(params->axis);
    lay_out_grid(a);
    if (!cell_grid_search(&a->grid, &a->base, &oracle, pool, e)) goto fail;
    if (a->grid.count == 0 && params->shape == ANALYTIC_HALFSPACE) {
        a->grid.crossing = mem_alloc(sizeof *a->grid.crossing);
        a->grid.count = 1;
    }
    if (a->grid.count == 0) {
        error_set(e, ERROR_NO_SURFACE, "the formula has no zero inside its domain: correct its parameters");
        goto fail;
    }
    return a;
fail:
    analytic_free(a);
    return NULL;
}

void analytic_free(analytic *a)
{
    if (!a) return;
    cell_grid_free(&a->grid);
    free(a);
}

bool analytic_shrink(analytic_frustum *f, double by)
{
    double rise = f->top - f->bottom, widening = f->top_radius - f->bottom_radius;
    double slope = rise > 0 ? widening / rise : 0, inwards = by * sqrt(1 + slope * slope);
    double bottom = f->bottom + by, top = f->top - by;
    double bottom_radius = f->bottom_radius + slope * by - inwards;
    double top_radius = f->top_radius - slope * by - inwards;
    if (!(bottom < top) || !(fmax(bottom_radius, top_radius) > 0)) return false;
    if (bottom_radius < 0) bottom -= bottom_radius / slope; /* the apex */
    if (top_radius < 0) top -= top_radius / slope;
    *f = (analytic_frustum){bottom, top, fmax(bottom_radius, 0), fmax(top_radius, 0)};
    return true;
}
