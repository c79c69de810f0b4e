#include "sizing/clearance.h"

#include <math.h>
#include <stdlib.h>

#include "base/compare.h"
#include "base/memory.h"
#include "field/projection.h"
#include "voronoi/resolution.h"

/* Places that are looked at: shares are told to a few tenths of a percent. */
enum { SAMPLES = 4096, GRAIN = 32 };
/* What may stay unresolved: a fifth of what the verdict allows, since points beside unresolved ones have no cell either, and
 * spacings are not even: the least is about nine tenths of the requested one. */
static const double LEFT_OVER = 0.004, UNEVEN = 0.9;
/* Rays: one along the normal to each side, and so many at this angle to it, at which a tube of the least diameter is
 * seen with the least gap. */
enum { TILTED = 6 };
static const double TILT = 0.58;
/* Steps along a ray, in cells. They grow by this factor, up to the longest: what is passed over is thin, and is seen from its own
 * places. Cells of patches are as large as the spacing, which says nothing of how thin parts are: there the first step
 * is a small one, and growth has no end. */
static const double STRIDE = 0.5, PATCH_STRIDE = 1.0 / 8, GROWTH = 1.02, PATCH_GROWTH = 1.3, LONGEST = 4;
/* On triangles |F| is the distance to them: a ray goes on by this share of it, and ends where it is larger than what is left of the
 * ray. */
static const double CLEAR = 0.9;
/* To the surface. */
static const int SETTLE_STEPS = 10;
static const double SETTLE = 1e-2;
static const uint64_t SEED = 1;

typedef struct clearance_job {
    const surface *scan;
    const sizing_field *sizing;
    double h;
    double *
        ratio; /* of each sample, largest spacing that resolves it over the requested one; INFINITY: none seen */
} clearance_job;

static double first_step(const field *f)
{
    return (f->patches ? PATCH_STRIDE : STRIDE) * f->cell_size;
}

/* Whether the ray from x meets the surface's other side within `reach`; then where, and the normal there. `inside`: it
 * goes into the solid. `hint`: as of field_sample_near, of x. */
static bool meet(const field *f, vec3 x, vec3 along, bool inside, double reach, uint32_t hint, vec3 *end,
                 vec3 *normal)
{
    const double growth = (f->patches ? PATCH_GROWTH : GROWTH) - 1,
                 longest = f->patches ? INFINITY : LONGEST * f->cell_size;
    const bool is_distance = f->ops->sample_patch_lanes != NULL; /* triangles of a mesh */
    double step = first_step(f), clear = 0;
    for (double t = step; t < reach + step; t += fmax(step, CLEAR * clear)) {
        step = fmax(step, fmin(growth * t, longest));
        field_sample s;
        vec3 at = vec3_axpy(t, along, x);
        if (!field_sample_near(f, at, FIELD_GRADIENT, &hint, &s)) continue;
        if ((s.value < 0) == inside) {
            if (is_distance) clear = fabs(s.value);
            if (clear > reach + step - t) return false;
            continue;
        }
        double slope = vec3_norm(s.gradient);
        if (!(slope > 0)) return false;
        *normal = vec3_scale(s.gradient, 1 / slope);
        *end = vec3_axpy(-s.value / slope, *normal, at);
        return true;
    }
    return false;
}

/* The largest spacing with which x and the other sheet at the end of a ray are told apart. */
static double spacing_at(const field *f, vec3 x, vec3 normal, vec3 along, bool inside, double reach,
                         uint32_t hint)
{
    vec3 end, other;
    if (!meet(f, x, along, inside, reach, hint, &end, &other) ||
        vec3_dot(normal, other) >= RESOLUTION_OPPOSITE)
        return INFINITY;
    vec3 r = vec3_sub(end, x);
    double gap = fmin(fabs(vec3_dot(normal, r)), fabs(vec3_dot(other, r)));
    double needed = fmax(gap / RESOLUTION_GAP, vec3_norm(r) / RESOLUTION_REACH);
    return fmax(needed, first_step(f) / RESOLUTION_GAP);
}

/* Of all rays from x. */
static double least_spacing(const field *f, vec3 x, vec3 normal, double reach)
{
    vec3 u = vec3_unit(vec3_cross(normal, fabs(normal.x) < 0.6 ? (vec3){1, 0, 0} : (vec3){0, 1, 0}));
    vec3 v = vec3_cross(normal, u);
    double least = INFINITY;
    uint32_t hint = FIELD_NO_HINT;
    field_sample at_x;
    field_sample_near(f, x, FIELD_GRADIENT, &hint, &at_x);
    for (int side = -1; side <= 1; side += 2) {
        vec3 axis = vec3_scale(normal, side);
        least = fmin(least, spacing_at(f, x, normal, axis, side < 0, reach, hint));
        for (int k = 0; k < TILTED; k++) {
            double angle = 2 * M_PI * k / TILTED;
            vec3 across = vec3_add(vec3_scale(u, cos(angle)), vec3_scale(v, sin(angle)));
            vec3 along = vec3_add(vec3_scale(axis, cos(TILT)), vec3_scale(across, sin(TILT)));
            least = fmin(least, spacing_at(f, x, normal, along, side < 0, reach, hint));
        }
    }
    return least;
}

static void measure_chunk(void *context, int worker, size_t begin, size_t end)
{
    const clearance_job *job = context;
    const field *f = job->scan->field;
    const projection_limits limits = {SETTLE_STEPS, SETTLE * f->cell_size, SETTLE * f->cell_size,
                                      f->cell_size};
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        rng r = rng_seed(SEED, k);
        vec3 normal, x = surface_point(job->scan, job->scan->area_before,
                                       ((double)k + rng_uniform(&r)) / SAMPLES * job->scan->area, &r, NULL);
        job->ratio[k] = INFINITY;
        if (!projection_find(f, &limits, &x, &normal)) continue;
        double spacing = job->sizing ? sizing_field_spacing(job->sizing, x, NULL) : job->h;
        job->ratio[k] = least_spacing(f, x, normal, RESOLUTION_REACH * spacing) / spacing;
    }
}

bool clearance_measure(const surface *scan, const sizing_field *sizing, double h, threads *pool,
                       clearance *out, error *e)
{
    clearance_job job = {scan, sizing, h, mem_array(SAMPLES, sizeof(double), "the clearance", e)};
    if (!job.ratio) return false;
    threads_run(pool, SAMPLES, GRAIN, measure_chunk, &job);
    bool ok = !threads_stopped(pool) || error_set(e, ERROR_CANCELLED, "stopped");
    size_t near = 0;
    qsort(job.ratio, SAMPLES, sizeof *job.ratio, compare_doubles);
    while (near < SAMPLES && job.ratio[near] < 1) near++;
    if (ok)
        *out =
            (clearance){(double)near / SAMPLES, fmin(UNEVEN * job.ratio[(size_t)(LEFT_OVER * SAMPLES)], 1)};
    free(job.ratio);
    return ok;
}
