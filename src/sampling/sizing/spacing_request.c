// SPDX-License-Identifier: Apache-2.0
#include "sampling/sizing/spacing_request.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "surface/field/patches.h"
#include "geometry/space/packing.h"
#include "sampling/sizing/feature_size.h"
#include "sampling/sizing/scaled_curvature.h"

/* The curvature at the fine end of a ratio is exceeded on this fraction of the area: initially, and at least.
 * A single tip or noise must not set the scale. */
static const double FINE_SHARE = 0.01, LEAST_FINE_SHARE = 0.00125;
/* A surface that bends by less than this angle, in radians, over the even spacing is flat: on flat facets
 * rounding leaves curvatures of 1e-15 and less, which differ from facet to facet. */
static const double FLAT_ANGLE = 1e-9;
/* The curvature that is exceeded on all but this fraction of the area limits the ratio at its coarse end. */
static const double FLAT_SHARE = 0.001;
/* Maximum spacing over the minimum, for a request without an upper end, as on flat faces. */
static const double WIDEST_REQUEST = 1e3;
/* Distance of the first octave, in mean spacings. */
static const double FINEST_OCTAVE = 0.125;
enum { OCTAVES = SPACING_REQUEST_OCTAVES };

static bool is_by_curvature(const sizing_field_params *params)
{
    return params->kind == SIZING_FIELD_CHORD || params->kind == SIZING_FIELD_RATIO;
}

bool spacing_request_is_map(const sizing_field_params *params)
{
    return params->kind == SIZING_FIELD_SPACING || params->kind == SIZING_FIELD_DENSITY;
}

bool spacing_request_is_implicit(const sizing_field_params *params)
{
    return is_by_curvature(params) && params->scale_spacings > 0 && !(params->scale_world > 0);
}

bool spacing_request_is_at_points(const sizing_field_params *params)
{
    return !is_by_curvature(params) || !(params->scale_spacings > 0 || params->scale_world > 0);
}

static double curvature_of(const spacing_request *r, double kappa, double kappa1, double kappa2)
{
    const double k = r->params->kind == SIZING_FIELD_CHORD ? fmax(fabs(kappa1), fabs(kappa2)) : kappa;
    return k * r->even < FLAT_ANGLE ? 0 : k;
}

static void request_cell(const spacing_request *r, size_t k)
{
    const sizing_field_params *p = r->params;
    vec3 x = r->samples.position[k];
    field_sample s;
    r->value[k] = NAN;
    if (!r->samples.found[k]) return;
    if (spacing_request_is_map(p)) {
        double v = p->map(p->map_context, x);
        r->value[k] = !isnan(v) ? v : p->kind == SIZING_FIELD_SPACING ? INFINITY : 0;
        return;
    }
    if (p->kind == SIZING_FIELD_EVEN) {
        r->value[k] = 1;
        return;
    }
    if (!field_sample_at(field_of_patch(r->scan->field, r->samples.patch[k]), x, FIELD_HESSIAN, &s)) return;
    double kappa1, kappa2, kappa = field_curvature(&s, &kappa1, &kappa2);
    r->value[k] = curvature_of(r, kappa, kappa1, kappa2);
}

static void request_chunk(void *context, int worker, size_t begin, size_t end)
{
    (void)worker;
    for (size_t k = begin; k < end; k++) request_cell(context, k);
}

/* Stores the curvature over one octave. */
typedef struct octave_job {
    spacing_request *request;
    const scaled_curvature *curvature;
    int octave;
} octave_job;

static void octave_chunk(void *context, int worker, size_t begin, size_t end)
{
    const octave_job *job = context;
    spacing_request *r = job->request;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        double kappa1, kappa2;
        if (isnan(r->value[k])) continue;
        double kappa = scaled_curvature_at(job->curvature, r->samples.position[k], r->samples.normal[k],
                                           r->samples.patch[k], &kappa1, &kappa2);
        r->curvature[OCTAVES * k + (size_t)job->octave] = curvature_of(r, kappa, kappa1, kappa2);
    }
}

static double octave_scale(double even, int octave)
{
    return ldexp(FINEST_OCTAVE * even, octave);
}

/* Measures all octaves; only one if the distance is constant. */
static bool measure_octaves(spacing_request *r, threads *pool, error *e)
{
    const sizing_field_params *p = r->params;
    r->curvature = mem_array(OCTAVES * r->scan->cells, sizeof *r->curvature, "the grading", e);
    if (!r->curvature) return false;
    octave_job job = {.request = r};
    for (; job.octave < (p->scale_world > 0 ? 1 : OCTAVES); job.octave++) {
        double scale =
            p->scale_world > 0 ? p->scale_world : p->scale_spacings * octave_scale(r->even, job.octave);
        if (job.octave > 0 && scale <= scaled_curvature_least(r->scan)) {
            for (double *own = r->curvature; own < r->curvature + OCTAVES * r->scan->cells; own += OCTAVES)
                own[job.octave] = own[job.octave - 1]; /* the distance is the same */
            continue;
        }
        scaled_curvature *c = scaled_curvature_new(r->scan, &r->samples, scale, pool, e);
        if (!c) return false;
        job.curvature = c;
        threads_run(pool, r->scan->cells, THREADS_GRAIN, octave_chunk, &job);
        scaled_curvature_free(c);
    }
    return true;
}

/* The curvature of a cell over `spacing`, interpolated between octaves in logarithms. */
static double curvature_over(const spacing_request *r, size_t k, double spacing)
{
    const double *c = &r->curvature[OCTAVES * k];
    if (!spacing_request_is_implicit(r->params)) return c[0];
    double at = fmin(fmax(elementary_log2(spacing / octave_scale(r->even, 0)), 0), OCTAVES - 1);
    int low = at < OCTAVES - 1 ? (int)at : OCTAVES - 2;
    return c[low] + (at - low) * (c[low + 1] - c[low]);
}

typedef struct weighted {
    double value, area;
} weighted;

static int compare_weighted(const void *a, const void *b)
{
    double x = ((const weighted *)a)->value, y = ((const weighted *)b)->value;
    return (x > y) - (x < y);
}

/* Quantiles by area: the values below which the given, ascending fractions of the area lie. */
static bool find_quantiles(const surface *scan, const double *value, int count, const double share[],
                           double out[], error *e)
{
    weighted *w = mem_array(scan->cells, sizeof *w, "the grading", e);
    if (!w) return false;
    size_t n = 0;
    double total = 0, below = 0;
    for (size_t k = 0; k < scan->cells; k++) {
        if (isnan(value[k])) continue;
        w[n++] = (weighted){value[k], surface_cell_area(scan, k)};
        total += surface_cell_area(scan, k);
    }
    qsort(w, n, sizeof *w, compare_weighted);
    size_t k = 0;
    for (int q = 0; q < count; q++) {
        while (k < n && below < share[q] * total) below += w[k++].area;
        out[q] = k > 0 ? w[k - 1].value : 0;
    }
    free(w);
    return true;
}

/* The spacing for a value, without the scale. `fine`: curvature at the fine end of a ratio. */
static double value_to_spacing(const sizing_field_params *p, double v, double fine)
{
    switch (p->kind) {
    case SIZING_FIELD_CHORD:
        return sqrt(8 * p->chord_error / v);
    case SIZING_FIELD_RATIO:
        return fmin(fmax(fine > 0 ? elementary_pow(v / fine, -p->exponent) : 1, 1), p->ratio);
    case SIZING_FIELD_DENSITY:
        return packing_spacing(1, v);
    default:
        return v;
    }
}

static bool check_map(const sizing_field_params *p, double v, error *e)
{
    if (v > 0 || (v == 0 && p->kind == SIZING_FIELD_DENSITY)) return true;
    return error_set(e, ERROR_INPUT_UNSUPPORTED,
                     "the map of sampling.grid has the value %g at a place of the surface: %s", v,
                     p->kind == SIZING_FIELD_SPACING ? "a spacing is above 0" : "a density is not below 0");
}

/* The curvature at the fine end of the ratio. */
static bool find_fine_end(spacing_request *r, const double *value, double *out, error *e)
{
    const double share[] = {FLAT_SHARE, 1 - r->fine_share, 1 - LEAST_FINE_SHARE};
    double at[3];
    if (!find_quantiles(r->scan, value, 3, share, at, e)) return false;
    *out = at[1];
    r->widest_ratio = elementary_pow(at[2] / at[0], r->params->exponent);
    return true;
}

bool spacing_request_refine(spacing_request *r)
{
    const sizing_field_params *p = r->params;
    const double share = 0.5 * r->fine_share;
    if (p->kind != SIZING_FIELD_RATIO || spacing_request_is_at_points(p) || !(r->widest_ratio >= p->ratio) ||
        share < LEAST_FINE_SHARE)
        return false;
    r->fine_share = share;
    return true;
}

bool spacing_request_find(spacing_request *r, const double *over, double *spacing, error *e)
{
    const sizing_field_params *p = r->params;
    const surface *scan = r->scan;
    double fine = 1, least = INFINITY;
    for (size_t k = 0; k < scan->cells; k++)
        spacing[k] = isnan(r->value[k]) || !r->curvature ? r->value[k] : curvature_over(r, k, over[k]);
    if (p->kind == SIZING_FIELD_RATIO && !find_fine_end(r, spacing, &fine, e)) return false;
    for (size_t k = 0; k < scan->cells; k++) {
        if (isnan(spacing[k])) continue;
        if (spacing_request_is_map(p) && !check_map(p, spacing[k], e)) return false;
        spacing[k] = value_to_spacing(p, spacing[k], fine);
        least = fmin(least, spacing[k]);
    }
    if (isinf(least)) {
        if (spacing_request_is_map(p))
            return error_set(
                e, ERROR_INPUT_UNSUPPORTED,
                "the map of sampling.grid requests no points anywhere on the surface: check that it "
                "overlaps the surface and has values there");
        least = 1; /* flat everywhere */
    }
    for (size_t k = 0; k < scan->cells; k++)
        if (!isnan(spacing[k]))
            spacing[k] = fmin(spacing[k], WIDEST_REQUEST * least); /* cells without a request */
    return true;
}

/* Replaces curvatures of the field by those that params->curvature computes. */
static bool request_at_points(spacing_request *r, threads *pool, error *e)
{
    static const char what[] = "the grading";
    const sizing_field_params *p = r->params;
    const size_t cells = r->scan->cells;
    size_t count = 0;
    vec3 *position = mem_array(cells, sizeof *position, what, e),
         *normal = mem_array(cells, sizeof *normal, what, e);
    uint32_t *patch = mem_array(cells, sizeof *patch, what, e);
    double *kappa1 = mem_array(cells, sizeof *kappa1, what, e),
           *kappa2 = mem_array(cells, sizeof *kappa2, what, e);
    bool ok = position && normal && patch && kappa1 && kappa2;
    for (size_t k = 0; ok && k < cells; k++) {
        if (isnan(r->value[k])) continue;
        position[count] = r->samples.position[k];
        normal[count] = r->samples.normal[k];
        patch[count++] = r->samples.patch[k];
    }
    ok = ok && p->curvature(p->curvature_context, count, position, normal, patch, pool, kappa1, kappa2, e);
    for (size_t k = cells; ok && k-- > 0;) {
        if (isnan(r->value[k])) continue;
        count--;
        if (isnan(kappa1[count])) continue;
        const double kappa = sqrt(kappa1[count] * kappa1[count] + kappa2[count] * kappa2[count]);
        r->value[k] = curvature_of(r, kappa, kappa1[count], kappa2[count]);
    }
    free(position);
    free(normal);
    free(patch);
    free(kappa1);
    free(kappa2);
    return ok;
}

bool spacing_request_begin(spacing_request *r, const surface *scan, const sizing_field_params *params,
                           double even, threads *pool, error *e)
{
    *r = (spacing_request){.params = params, .scan = scan, .even = even, .fine_share = FINE_SHARE};
    r->value = mem_array(scan->cells, sizeof *r->value, "the grading", e);
    if (!r->value || !cell_samples_take(scan, pool, &r->samples, e)) return false;
    threads_run(pool, scan->cells, THREADS_GRAIN, request_chunk, r);
    if (!spacing_request_is_at_points(params) && !measure_octaves(r, pool, e)) return false;
    if (is_by_curvature(params) && spacing_request_is_at_points(params) && params->curvature &&
        !request_at_points(r, pool, e))
        return false;
    if (params->feature_ratio > 0) {
        r->feature = mem_array(scan->cells, sizeof *r->feature, "the grading", e);
        if (!r->feature || !feature_size_measure(scan, &r->samples, pool, r->feature, e)) return false;
    }
    return threads_may_go_on(pool, e);
}

bool spacing_request_describe_features(const spacing_request *r, spacing_request_features *out, error *e)
{
    spacing_request_features f = {.least = INFINITY, .floor = r->params->feature_floor};
    const double half = 0.5;
    double floored = 0;
    if (!find_quantiles(r->scan, r->feature, 1, &half, &f.median, e)) return false;
    for (size_t k = 0; k < r->scan->cells; k++) {
        double area = surface_cell_area(r->scan, k), size = r->feature[k];
        f.least = fmin(f.least, size);
        f.points += area / packing_cell_area(spacing_request_cap(r->params, size));
        if (r->params->feature_ratio * size < r->params->feature_floor) floored += area;
    }
    f.floored_share = floored / r->scan->area;
    *out = f;
    return true;
}

void spacing_request_free(spacing_request *r)
{
    cell_samples_free(&r->samples);
    free(r->value);
    free(r->curvature);
    free(r->feature);
}
