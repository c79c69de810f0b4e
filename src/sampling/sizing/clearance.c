// SPDX-License-Identifier: Apache-2.0
#include "sampling/sizing/clearance.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/compare.h"
#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "surface/field/projection.h"
#include "sampling/voronoi/resolution.h"

/* Number of sampled places: a fraction of 2 % has a standard deviation below 0.5 %. If no wall is close to
 * any of the FIRST ones, the others are not sampled: with thin walls on 2 % of the surface the probability
 * of that is 0.6 %. */
enum { SAMPLES = 1024, FIRST = 256, GRAIN = 16 };
/* Minimum spacing of a packing, over the requested spacing. */
static const double UNEVEN = 0.9;
/* Rays to each side: one along the normal, and TILTED at the angle TILT (radians) to it. At this angle the
 * tube of smallest diameter is seen with the smallest gap. */
enum { TILTED = 6 };
static const double TILT = 0.58;
/* Steps along a ray, in cell sizes. They grow by a factor up to LONGEST: walls that are skipped are thin, and
 * are found from their own places. Cells of patches are as large as the spacing, which is unrelated to the
 * thickness of parts: there the first step is small, and growth is unlimited. */
static const double STRIDE = 0.5, PATCH_STRIDE = 1.0 / 8, GROWTH = 1.02, PATCH_GROWTH = 1.3, LONGEST = 4;
/* Cosine of the normals above which two walls may meet in an edge or a tip: at 37 degrees and more. Near an edge they
 * are closer than any spacing, but only within 1.7 gaps of it. A sharper part is thin beside its edge as well. */
static const double BLUNT = -0.8;
/* Maximum distance, over that of the other rays, at which the ray along the normal meets a wall at an edge: at
 * RESOLUTION_OPPOSITE it is 1.2 / 0.4 spacings. */
static const double NORMAL_REACH = 1.77;
/* How far beyond the line in which the tangent planes meet an edge is searched, over the distance of that line. */
static const double EDGE_REACH = 1.5;
/* Newton steps to the surface, and their tolerance in cell sizes. */
static const int PROJECT_STEPS = 10;
static const double PROJECT_TOLERANCE = 1e-2;
static const uint64_t SEED = 1;

typedef struct clearance_job {
    const surface *scan;
    const sizing_field *sizing;
    double h;
    size_t begin; /* first sample to measure */
    double *
        /* Per sample: the largest spacing that resolves it over the requested one; INFINITY: no opposite
         * wall. */
        ratio;
} clearance_job;

static double first_step(const field *f)
{
    return (f->patches ? PATCH_STRIDE : STRIDE) * f->cell_size;
}

/* The rays from x to one side. */
typedef struct bundle {
    vec3 x, normal;
    bool inside;   /* they go into the solid */
    uint32_t hint; /* see field_sample_near, for x */
} bundle;

/* Whether a ray meets an opposite wall within `reach`; *end, *normal: where. */
static bool meet(const field *f, const bundle *b, vec3 along, double reach, vec3 *end, vec3 *normal)
{
    if (f->ops->first_crossing) {
        double distance;
        if (!f->ops->first_crossing(f, b->x, along, reach, b->hint, &distance, normal)) return false;
        *end = vec3_axpy(distance, along, b->x);
        return true;
    }
    const double growth = (f->patches ? PATCH_GROWTH : GROWTH) - 1,
                 longest = f->patches ? INFINITY : LONGEST * f->cell_size;
    double step = first_step(f);
    uint32_t hint = b->hint;
    for (double t = step; t < reach + step; t += step) {
        step = fmax(step, fmin(growth * t, longest));
        field_sample s;
        vec3 at = vec3_axpy(t, along, b->x);
        if (!field_sample_near(f, at, FIELD_GRADIENT, &hint, &s)) continue;
        if ((s.value < 0) == b->inside) continue;
        double slope = vec3_norm(s.gradient);
        if (!(slope > 0)) return false;
        *normal = vec3_scale(s.gradient, 1 / slope);
        *end = vec3_axpy(-s.value / slope, *normal, at);
        return true;
    }
    return false;
}

/* The spacing that is returned for all walls closer than the first step of a ray. */
static double least_resolved(const field *f)
{
    return first_step(f) / RESOLUTION_GAP;
}

/* The largest spacing that separates b->x from the wall at the end of a ray. */
static double spacing_at(const field *f, const bundle *b, vec3 along, double reach)
{
    vec3 end, other;
    if (!meet(f, b, along, reach, &end, &other) || vec3_dot(b->normal, other) >= RESOLUTION_OPPOSITE)
        return INFINITY;
    vec3 r = vec3_sub(end, b->x);
    double gap = fmin(fabs(vec3_dot(b->normal, r)), fabs(vec3_dot(other, r)));
    double needed = fmax(gap / RESOLUTION_GAP, vec3_norm(r) / RESOLUTION_REACH);
    return fmax(needed, least_resolved(f));
}

/* Whether the wall opposite to x, along `axis`, meets the wall of x in an edge or a tip beside x: a ray between both,
 * towards the line in which their tangent planes meet, leaves through a wall. */
static bool is_beside_edge(const field *f, const bundle *b, vec3 axis, double reach)
{
    vec3 end, other;
    if (!meet(f, b, axis, reach, &end, &other)) return false;
    const double cosine = vec3_dot(b->normal, other);
    if (cosine < BLUNT || cosine >= RESOLUTION_OPPOSITE) return false;
    const vec3 across = vec3_axpy(-cosine, b->normal, other), between = vec3_sub(end, b->x);
    const double sine = vec3_norm(across), away = fabs(vec3_dot(other, between)) / sine;
    const bundle middle = {vec3_axpy(0.5, between, b->x), b->normal, b->inside, FIELD_NO_HINT};
    return meet(f, &middle, vec3_scale(across, (b->inside ? 1 : -1) / sine), EDGE_REACH * away, &end, &other);
}

/* The minimum over all rays from x. `hint`: of x, see field_sample_near. */
static double least_spacing(const field *f, vec3 x, vec3 normal, uint32_t hint, double reach)
{
    vec3 u = vec3_unit(vec3_cross(normal, fabs(normal.x) < 0.6 ? (vec3){1, 0, 0} : (vec3){0, 1, 0}));
    vec3 v = vec3_cross(normal, u);
    double least = INFINITY;
    bundle b = {.x = x, .normal = normal, .hint = hint};
    for (int side = -1; side <= 1 && least > least_resolved(f); side += 2) {
        vec3 axis = vec3_scale(normal, side);
        b.inside = side < 0;
        if (is_beside_edge(f, &b, axis, NORMAL_REACH * reach)) continue;
        least = fmin(least, spacing_at(f, &b, axis, fmin(reach, RESOLUTION_REACH * least)));
        for (int k = 0; k < TILTED; k++) {
            double angle = 2 * M_PI * k / TILTED;
            vec3 across =
                vec3_add(vec3_scale(u, elementary_cos(angle)), vec3_scale(v, elementary_sin(angle)));
            vec3 along =
                vec3_add(vec3_scale(axis, elementary_cos(TILT)), vec3_scale(across, elementary_sin(TILT)));
            /* a wall beyond this distance is separated by a larger spacing */
            const double farthest = fmin(reach, RESOLUTION_REACH * least);
            least = fmin(least, spacing_at(f, &b, along, farthest));
        }
    }
    return least;
}

static void measure_chunk(void *context, int worker, size_t begin, size_t end)
{
    const clearance_job *job = context;
    const field *f = job->scan->field;
    const projection_limits limits = {PROJECT_STEPS, PROJECT_TOLERANCE * f->cell_size,
                                      PROJECT_TOLERANCE * f->cell_size, f->cell_size};
    (void)worker;
    for (size_t k = job->begin + begin; k < job->begin + end; k++) {
        rng r = rng_seed(SEED, k);
        const size_t part = k % FIRST * (SAMPLES / FIRST) + k / FIRST; /* the FIRST ones are spread evenly */
        const double area = ((double)part + rng_uniform(&r)) / SAMPLES * job->scan->area;
        vec3 normal, x = surface_point(job->scan, job->scan->area_before, area, &r, NULL);
        job->ratio[k] = INFINITY;
        uint32_t hint = FIELD_NO_HINT;
        if (!projection_find_near(f, &limits, &hint, &x, &normal)) continue;
        double spacing = job->sizing ? sizing_field_spacing(job->sizing, x, NULL) : job->h;
        job->ratio[k] = least_spacing(f, x, normal, hint, RESOLUTION_REACH * spacing) / spacing;
    }
}

/* The number of samples, of the first `count`, whose walls the requested spacing does not separate. */
static size_t count_near(const clearance_job *job, size_t count)
{
    size_t near = 0;
    for (size_t k = 0; k < count; k++) near += job->ratio[k] < 1;
    return near;
}

double clearance_spacing(double distance)
{
    return UNEVEN * distance / RESOLUTION_GAP;
}

bool clearance_measure(const surface *scan, const sizing_field *sizing, double h, threads *pool,
                       double allowed, clearance *out, error *e)
{
    clearance_job job = {scan, sizing, h, 0, mem_array(SAMPLES, sizeof(double), "the clearance", e)};
    if (!job.ratio) return false;
    size_t count = FIRST;
    threads_run(pool, FIRST, GRAIN, measure_chunk, &job);
    if (count_near(&job, FIRST) > 0) {
        job.begin = FIRST;
        count = SAMPLES;
        threads_run(pool, SAMPLES - FIRST, GRAIN, measure_chunk, &job);
    }
    bool ok = threads_may_go_on(pool, e);
    qsort(job.ratio, count, sizeof *job.ratio, compare_doubles);
    if (ok)
        *out = (clearance){(double)count_near(&job, count) / (double)count,
                           fmin(UNEVEN * job.ratio[(size_t)(allowed * (double)count)], 1),
                           sizing ? 0 : fmin(UNEVEN * (least_resolved(scan->field) / h), 1)};
    free(job.ratio);
    return ok;
}
