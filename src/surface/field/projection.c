// SPDX-License-Identifier: Apache-2.0
#include "surface/field/projection.h"

#include <math.h>
#include <string.h>

static const double CELLS_MOST = 5;
/* Steps of projection_draft. Newton's method takes at most 10 steps within a grid cell, and up to 50 from
 * random places in the domain of a formula. */
enum { DRAFT_STEPS = 50 };
static const double DRAFT_ACCURACY = 1e-3;

projection_limits projection_draft(double length)
{
    const double accuracy = DRAFT_ACCURACY * length;
    return (projection_limits){DRAFT_STEPS, accuracy, accuracy, accuracy};
}

double projection_scale(const field *f, double spacing)
{
    return fmin(spacing, CELLS_MOST * f->cell_size);
}

/* Clamps x to the box and adds the axes that were clamped (bits 1, 2, 4) to *pinned. */
static void clamp_to_domain(const field *f, vec3 *x, unsigned *pinned)
{
    if (!f->open) return;
    for (int axis = 0; axis < 3; axis++) {
        double v = vec3_get(*x, axis);
        double inside = fmin(fmax(v, vec3_get(f->domain.min, axis)), vec3_get(f->domain.max, axis));
        if (inside == v) continue;
        vec3_set(x, axis, inside);
        *pinned |= 1u << axis;
    }
}

unsigned projection_boundary_axes(const field *f, vec3 x)
{
    unsigned axes = 0;
    for (int axis = 0; f->open && axis < 3; axis++) {
        double v = vec3_get(x, axis);
        if (v == vec3_get(f->boundary_box.min, axis) || v == vec3_get(f->boundary_box.max, axis))
            axes |= 1u << axis;
    }
    return axes;
}

/* The Newton step of a sample, restricted to the faces in which x is pinned. */
static bool newton_step(const field_sample *s, unsigned pinned, vec3 *step)
{
    vec3 g = s->gradient;
    for (int axis = 0; axis < 3; axis++)
        if (pinned >> axis & 1) vec3_set(&g, axis, 0);
    double g2 = vec3_norm2(g);
    if (!(g2 > 0)) return false;
    *step = vec3_scale(g, -s->value / g2);
    return true;
}

bool projection_find(const field *f, const projection_limits *limits, vec3 *x, vec3 *normal)
{
    return projection_find_near(f, limits, &(uint32_t){FIELD_NO_HINT}, x, normal);
}

/* Newton's iteration from *x. *s: the last sample. *seen: it was taken at the final *x. */
static bool find_place(const field *f, const projection_limits *limits, uint32_t *hint, vec3 *x,
                       field_sample *s, bool *seen)
{
    vec3 p = *x, step;
    unsigned pinned = projection_boundary_axes(f, p);
    clamp_to_domain(f, &p, &pinned);
    for (int k = 0;; k++) {
        if (!field_sample_near(f, p, FIELD_GRADIENT, hint, s)) return false;
        double length = vec3_norm(s->gradient);
        if (!(length > 0)) return false;
        double distance = fabs(s->value) / length;
        bool done = *seen = distance <= limits->accept;
        if (!done && k == limits->max_steps) {
            if (!(distance <= limits->reject)) return false;
            done = *seen = true;
        }
        if (!done) {
            if (!newton_step(s, pinned, &step)) return false;
            p = vec3_add(p, step);
            clamp_to_domain(f, &p, &pinned);
            done = distance <= limits->shortcut && !pinned;
        }
        if (done) {
            *x = p;
            return true;
        }
    }
}

bool projection_find_near(const field *f, const projection_limits *limits, uint32_t *hint, vec3 *x,
                          vec3 *normal)
{
    field_sample s;
    bool seen;
    if (!find_place(f, limits, hint, x, &s, &seen)) return false;
    *normal = vec3_scale(s.gradient, 1 / vec3_norm(s.gradient));
    return true;
}

void projection_find_lanes(const field *f, const projection_limits *limits, const double unit[VEC3_LANES],
                           const uint32_t patch[VEC3_LANES], bool defined[VEC3_LANES],
                           uint32_t hint[VEC3_LANES], vec3_lanes *x, vec3_lanes *normal)
{
    vec3_lanes p = *x, gradient;
    bool open[VEC3_LANES], any = true;
    for (int l = 0; l < VEC3_LANES; l++) open[l] = defined[l];
    for (int k = 0; any; k++) {
        double value[VEC3_LANES];
        bool seen[VEC3_LANES];
        memcpy(seen, open, sizeof seen);
        if (patch)
            f->ops->sample_patch_lanes(f, patch, &p, seen, hint, value, &gradient);
        else
            field_sample_lanes(f, &p, seen, value, &gradient);
        any = false;
        for (int l = 0; l < VEC3_LANES; l++) {
            if (!open[l]) continue;
            vec3 at = vec3_lanes_get(&p, l);
            const vec3 g = vec3_lanes_get(&gradient, l);
            const double length = seen[l] ? vec3_norm(g) : 0;
            const double distance = length > 0 ? fabs(value[l]) / length / unit[l] : INFINITY;
            bool done = distance <= limits->accept || (k == limits->max_steps && distance <= limits->reject);
            defined[l] = length > 0 && (done || k < limits->max_steps);
            if (defined[l] && !done) {
                at = vec3_axpy(-value[l] / (length * length), g, at);
                vec3_lanes_put(&p, l, at);
                done = distance <= limits->shortcut;
            }
            open[l] = defined[l] && !done;
            any |= open[l];
            if (!defined[l] || !done) continue;
            vec3_lanes_put(x, l, at);
            vec3_lanes_put(normal, l, vec3_scale(g, 1 / length));
        }
    }
}

bool projection_sample(const field *f, const projection_limits *limits, uint32_t *hint, vec3 *x,
                       field_sample *sample)
{
    vec3 p = *x;
    field_sample s;
    bool seen;
    if (!find_place(f, limits, hint, &p, &s, &seen)) return false;
    if (!seen && !field_sample_near(f, p, FIELD_GRADIENT, hint, &s)) return false;
    *x = p;
    *sample = s;
    return true;
}

/* Steps in each direction in which `reach` is searched for a change of sign; and bisections, to 2^-52 of a
 * step. */
enum { SEARCH_STEPS = 32, HALVINGS = 52 };

/* The nearest interval [*a, *b] of `x + t along` with a change of sign. */
static bool find_bracket(const field *f, vec3 x, vec3 along, double reach, double *a, double *b)
{
    field_sample s;
    if (!field_sample_at(f, x, FIELD_GRADIENT, &s)) return false;
    bool inside = s.value < 0;
    for (int k = 1; k <= SEARCH_STEPS; k++)
        for (int side = -1; side <= 1; side += 2) {
            double t = side * reach * k / SEARCH_STEPS;
            if (!field_sample_at(f, vec3_axpy(t, along, x), FIELD_GRADIENT, &s) || (s.value < 0) == inside)
                continue;
            *a = side * reach * (k - 1) / SEARCH_STEPS;
            *b = t;
            return true;
        }
    return false;
}

bool projection_bisect(const field *f, vec3 along, double reach, vec3 *x, vec3 *normal)
{
    double a, b;
    field_sample at_a, s;
    if (!find_bracket(f, *x, along, reach, &a, &b) ||
        !field_sample_at(f, vec3_axpy(a, along, *x), FIELD_GRADIENT, &at_a))
        return false;
    for (int k = 0; k < HALVINGS; k++) {
        double middle = 0.5 * (a + b);
        if (!field_sample_at(f, vec3_axpy(middle, along, *x), FIELD_GRADIENT, &s)) return false;
        if ((s.value < 0) == (at_a.value < 0))
            a = middle;
        else
            b = middle;
    }
    vec3 p = vec3_axpy(a, along, *x);
    if (f->open && !bbox_contains(f->domain, p)) return false;
    if (!field_sample_at(f, p, FIELD_GRADIENT, &s) || !(vec3_norm2(s.gradient) > 0)) return false;
    *x = p;
    *normal = vec3_unit(s.gradient);
    return true;
}
