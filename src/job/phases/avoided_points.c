// SPDX-License-Identifier: Apache-2.0
#include "job/phases/avoided_points.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "base/core/rng.h"
#include "geometry/space/point_tree.h"
#include "geometry/space/packing.h"
#include "sampling/sizing/sizing_field.h"
#include "sampling/solver/particles/random_streams.h"
#include "job/source/plan.h"

/* Number of samples of the surface per point of the result, and its bounds. */
static const double SAMPLES_PER_POINT = 4, SAMPLES_LEAST = 20000, SAMPLES_MOST = 2e6;
/* Factor of the slack. The number of points of a packing within an area varies with the position of the
 * lattice: its standard deviation is 0.17 to 0.33 times the square root of the number of cells on the border
 * of the area. Larger: points are farther from the given ones than required. */
static const double BORDER_VARIATION = 0.75;
/* Another packing is made if points are missing, or if the excess is more than EXCESS_SLACKS times the
 * slack. ROUNDS_MOST: maximum number of packings. */
static const double EXCESS_SLACKS = 4;
enum { ROUNDS_MOST = 4 };
/* Relative rounding error of coordinates stored as floats. */
static const double FLOAT_ROUNDING = 0x1p-23;

static const char what[] = "the points that are far enough from the given points";

static bool avoids(const spec *s)
{
    return s->has_points && s->points.mode == SPEC_POINTS_AVOID;
}

static vec3 in_world(const source *from, vec3 x)
{
    return from->turned ? placement_to_world(from->turned, x) : x;
}

/* Sets the number of points of a packing of which the fraction `share` is `wanted` points. */
static bool set_packed(double wanted, double share, size_t *packed, error *e)
{
    const double count = ceil(wanted / share);
    if (!(count <= PLAN_COUNT_MAX))
        return error_set(e, ERROR_SPEC_INVALID,
                         "/sampling/points/distance: %.3g %% of the surface are far enough from the given "
                         "points, so that a packing of all of it has %.0f points, more than the maximum of "
                         "%.0f: reduce the distance or the count",
                         100 * share, count, PLAN_COUNT_MAX);
    *packed = (size_t)fmax(count, PLAN_COUNT_MIN);
    return true;
}

/* Counts of samples of the surface, which are uniform in area. */
typedef struct sample_counts {
    size_t all;
    size_t far;    /* far enough from the given points */
    size_t border; /* of these, those within a spacing of the others */
} sample_counts;

static bool sample_surface(const given_points *g, const spec *s, const source *from, const surface *scan,
                           size_t count, const threads *pool, sample_counts *out, error *e)
{
    const double h = packing_spacing(scan->area, (double)count), distance = s->points.distance;
    point_tree *tree = point_tree_new(g->world, g->count, e);
    rng r = rng_seed(s->seed, RANDOM_STREAM_AVOIDED);
    surface_last_cell last = {.known = false};
    if (!tree) return false;
    *out = (sample_counts){
        .all = (size_t)fmin(fmax(SAMPLES_PER_POINT * (double)count, SAMPLES_LEAST), SAMPLES_MOST)};
    for (size_t k = 0; k < out->all && !threads_stopped(pool); k++) {
        const double where = ((double)k + rng_uniform(&r)) / (double)out->all;
        const vec3 x = in_world(from, sizing_field_draw(NULL, scan, where, &r, &last));
        double nearest;
        point_tree_nearest(tree, x, 0, &nearest);
        out->far += nearest >= distance;
        out->border += nearest >= distance && nearest < distance + h;
    }
    point_tree_free(tree);
    return threads_may_go_on(pool, e);
}

bool avoided_points_plan(const given_points *g, const spec *s, const source *from, const surface *scan,
                         size_t count, threads *pool, avoided_points *out, size_t *packed, error *e)
{
    sample_counts found;
    *out = (avoided_points){0};
    if (!avoids(s)) return true;
    if (!sample_surface(g, s, from, scan, count, pool, &found, e)) return false;
    if (found.far == 0)
        return error_set(e, ERROR_NO_SURFACE,
                         "/sampling/points/distance: no place of the surface is %g or more from the given "
                         "points: reduce the distance",
                         s->points.distance);
    if (s->count == 0) return true;
    out->wanted = count;
    out->slack = 1 + BORDER_VARIATION * sqrt((double)found.border / (double)found.far * (double)count);
    return set_packed((double)count + out->slack, (double)found.far / (double)found.all, packed, e);
}

/* A point of the packing and its distance from the given points. */
typedef struct ranked {
    double distance;
    uint32_t point;
} ranked;

static int compare_ranks(const void *a, const void *b)
{
    const ranked *p = a, *q = b;
    if (p->distance != q->distance) return p->distance > q->distance ? -1 : 1;
    return (p->point > q->point) - (p->point < q->point);
}

/* Sorts the points, farthest first. *far: number of points that are far enough, also after their coordinates
 * are rounded to floats. */
static bool rank_points(const given_points *g, const spec *s, const source *from, const vec3 *position,
                        size_t count, ranked *out, size_t *far, error *e)
{
    point_tree *tree = point_tree_new(g->world, g->count, e);
    if (!tree) return false;
    *far = 0;
    for (uint32_t i = 0; i < count; i++) {
        const vec3 x = in_world(from, position[i]);
        const double rounding = FLOAT_ROUNDING * (fabs(x.x) + fabs(x.y) + fabs(x.z));
        out[i].point = i;
        point_tree_nearest(tree, x, 0, &out[i].distance);
        *far += out[i].distance >= s->points.distance + rounding;
    }
    point_tree_free(tree);
    qsort(out, count, sizeof *out, compare_ranks);
    return true;
}

/* Whether the packing is accepted. Otherwise *packed is the number of points of the next one. */
static bool judge(avoided_points *a, const spec *s, size_t far, size_t count, size_t *packed, error *e)
{
    const double most = (double)a->wanted + EXCESS_SLACKS * a->slack;
    *packed = 0;
    if (far == 0)
        return error_set(
            e, ERROR_NO_SURFACE,
            "/sampling/points/distance: none of %zu points on the surface is %g or more from the "
            "given points: reduce the distance, or ask for more points",
            count, s->points.distance);
    if (a->wanted == 0 || (far >= a->wanted && (double)far <= most)) return true;
    if (a->rounds++ < ROUNDS_MOST)
        return set_packed((double)a->wanted + a->slack, (double)far / (double)count, packed, e);
    return far >= a->wanted ||
           error_set(
               e, ERROR_NO_SURFACE,
               "/sampling/points/distance: %zu of %zu points are %g or more from the given points: reduce "
               "the distance",
               far, a->wanted, s->points.distance);
}

bool avoided_points_choose(avoided_points *a, const given_points *g, const spec *s, const source *from,
                           const vec3 *position, size_t count, size_t *packed, error *e)
{
    size_t far;
    *packed = 0;
    if (!avoids(s)) return true;
    ranked *rank = mem_array(count, sizeof *rank, what, e);
    bool *taken = rank ? mem_array(count, sizeof *taken, what, e) : NULL;
    const bool ok = taken && rank_points(g, s, from, position, count, rank, &far, e) &&
                    judge(a, s, far, count, packed, e);
    if (ok && *packed == 0) {
        a->taken_count = a->wanted > 0 ? a->wanted : far;
        a->packed_count = count;
        a->nearest = rank[a->taken_count - 1].distance;
        for (size_t k = 0; k < a->taken_count; k++) taken[rank[k].point] = true;
        a->taken = taken;
        taken = NULL;
    }
    free(rank);
    free(taken);
    return ok;
}

void avoided_points_describe(const avoided_points *a, json *report)
{
    if (!a->taken) return;
    json *points = json_find(report, "/points");
    json_put_integer(points, "packed", (int64_t)a->packed_count);
    json_put_number(points, "nearest", a->nearest);
}

void avoided_points_free(avoided_points *a)
{
    free(a->taken);
    *a = (avoided_points){0};
}
