// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/curves/curve_chains.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "sampling/packing/point_flags.h"

double curve_chains_length(const field_patches *patches, const field_curve *curve)
{
    double length = 0;
    for (size_t k = 1; k < curve->count + curve->closed; k++)
        length += vec3_norm(vec3_sub(patches->vertex[curve->first + k % curve->count],
                                     patches->vertex[curve->first + k - 1]));
    return length;
}

/* ---- corners */

typedef struct corner {
    vec3 at;
    uint32_t point; /* that represents it, or NONE */
    double length;  /* of the curve to the corner whose point it shares; 0: own point; INFINITY: none */
} corner;

static const uint32_t NONE = UINT32_MAX;

static int compare_corners(const void *a, const void *b)
{
    const corner *x = a, *y = b;
    int order = vec3_compare(x->at, y->at);
    return order ? order : (x->point > y->point) - (x->point < y->point);
}

typedef struct corners {
    corner *list; /* ascending by position */
    size_t count;
} corners;

/* The corner at a position; it exists. */
static corner *find_corner(const corners *all, vec3 at)
{
    size_t low = 0, high = all->count;
    while (low < high) {
        size_t middle = (low + high) / 2;
        if (vec3_compare(all->list[middle].at, at) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return &all->list[low];
}

static vec3 end_of(const field_patches *p, const field_curve *c, int which)
{
    return p->vertex[c->first + (which == 0 ? 0 : c->count - 1)];
}

/* Maximum distance between a corner and the point that represents it, in spacings: the largest merge distance of
 * near_curves. */
static const double SHARED_POINT_DISTANCE = 0.65;

static bool is_near(const solver_points *solved, uint32_t point, vec3 at)
{
    return vec3_norm(vec3_sub(solved->position[point], at)) <= SHARED_POINT_DISTANCE * solved->spacing[point];
}

/* A corner without a point shares the point at the far end of its shortest curve. */
static void share_points(const field_patches *p, const solver_points *solved, corners *all)
{
    for (size_t c = 0; c < p->curve_count; c++)
        for (int k = 0; k < 2 && !p->curve[c].closed; k++) {
            corner *own = find_corner(all, end_of(p, &p->curve[c], k));
            const corner *other = find_corner(all, end_of(p, &p->curve[c], 1 - k));
            const double length = curve_chains_length(p, &p->curve[c]);
            if (own->length == 0 || other->length != 0 || !(length < own->length)) continue;
            if (!is_near(solved, other->point, own->at)) continue;
            own->length = length;
            own->point = other->point;
        }
}

/* `by_sample`: points by curve sample, corners first. */
static void find_corners(const field_patches *p, const solver_points *solved, const uint32_t *by_sample,
                         const curve_chains *chains, corners *out)
{
    out->list = mem_alloc((chains->corners + 2 * p->curve_count) * sizeof *out->list);
    for (size_t k = 0; k < chains->corners; k++)
        out->list[out->count++] = (corner){solved->position[by_sample[k]], by_sample[k], 0};
    for (size_t c = 0; c < p->curve_count; c++)
        for (int k = 0; k < 2 && !p->curve[c].closed; k++)
            out->list[out->count++] = (corner){end_of(p, &p->curve[c], k), NONE, INFINITY};
    qsort(out->list, out->count, sizeof *out->list, compare_corners);
    size_t kept = 0;
    for (size_t k = 0; k < out->count; k++)
        if (kept == 0 || vec3_compare(out->list[kept - 1].at, out->list[k].at) != 0)
            out->list[kept++] = out->list[k];
    out->count = kept;
    share_points(p, solved, out);
}

/* ---- chains */

/* Points by curve sample: corners first, then curve after curve, each from its start to its end. */
static uint32_t *points_by_sample(const solver_points *solved, curve_chains *out)
{
    const solver_patch_points *patch_points = &solved->patch_points;
    for (size_t k = 0; k < solved->count; k++) {
        out->points += solved->feature[k] != SOLVER_ON_PATCH;
        out->corners += solved->feature[k] == SOLVER_ON_CORNER;
    }
    uint32_t *by_sample = mem_alloc(out->points * sizeof *by_sample);
    for (size_t k = 0; k < patch_points->count; k++)
        if (solved->feature[patch_points->point[k]] != SOLVER_ON_PATCH)
            by_sample[patch_points->place[k]] = patch_points->point[k];
    return by_sample;
}

static void add_point(curve_chains *out, size_t begin, size_t *count, uint32_t point)
{
    if (point != NONE && (*count == begin || out->point[*count - 1] != point)) out->point[(*count)++] = point;
}

void curve_chains_make(const field_patches *patches, const solver_points *solved, curve_chains *out)
{
    corners all = {0};
    *out = (curve_chains){0};
    uint32_t *by_sample = points_by_sample(solved, out);
    size_t count = 0, k = out->corners;
    out->first = mem_alloc((patches->curve_count + 1) * sizeof *out->first);
    out->point = mem_alloc((out->points + 2 * patches->curve_count) * sizeof *out->point);
    find_corners(patches, solved, by_sample, out, &all);
    for (size_t c = 0; c < patches->curve_count; c++) {
        const field_curve *curve = &patches->curve[c];
        const size_t begin = out->first[c] = count;
        if (!curve->closed)
            add_point(out, begin, &count, find_corner(&all, end_of(patches, curve, 0))->point);
        for (; k < out->points && solved->curve[k] == c; k++) add_point(out, begin, &count, by_sample[k]);
        if (!curve->closed)
            add_point(out, begin, &count, find_corner(&all, end_of(patches, curve, 1))->point);
    }
    out->first[patches->curve_count] = count;
    free(all.list);
    free(by_sample);
}

void curve_chains_free(curve_chains *c)
{
    free(c->first);
    free(c->point);
    *c = (curve_chains){0};
}

/* ---- sides */

/* A patch point on a curve; index: in solver_patch_points. */
typedef struct curve_point {
    uint32_t point, patch, index;
} curve_point;

static int compare_curve_points(const void *a, const void *b)
{
    const curve_point *x = a, *y = b;
    if (x->point != y->point) return x->point > y->point ? 1 : -1;
    return (x->patch > y->patch) - (x->patch < y->patch);
}

static curve_point *list_curve_points(const solver_patch_points *s, size_t *count)
{
    curve_point *list = mem_alloc(s->count * sizeof *list);
    *count = 0;
    for (size_t k = 0; k < s->count; k++)
        if (s->flags[k] & PACKING_FIXED)
            list[(*count)++] = (curve_point){s->point[k], s->patch[k], (uint32_t)k};
    qsort(list, *count, sizeof *list, compare_curve_points);
    return list;
}

/* Minimum length of a step that skips merged samples, in spacings. Regular steps are about 1. */
static const double JUMP_LENGTH = 2;

bool curve_chains_jumps(const field_patches *patches, double step, double one, double other)
{
    return patches->merges_near_curves && step > JUMP_LENGTH * fmax(one, other);
}

static bool is_jump(const field_patches *p, const solver_patch_points *s, uint32_t a, uint32_t b)
{
    const double step = vec3_norm(vec3_sub(s->position[a], s->position[b]));
    return curve_chains_jumps(p, step, s->spacing[a], s->spacing[b]);
}

uint32_t (*curve_chains_sides(const curve_chains *c, const field_patches *patches,
                              const solver_patch_points *patch_points, size_t *count))[2]
{
    size_t most = 0, known;
    for (size_t k = 0; k < patches->curve_count; k++)
        most += (c->first[k + 1] - c->first[k]) * patches->curve[k].patch_count;
    uint32_t(*side)[2] = mem_alloc((most + 1) * sizeof *side);
    curve_point *list = list_curve_points(patch_points, &known);
    *count = 0;
    for (size_t k = 0; k < patches->curve_count; k++) {
        const field_curve *curve = &patches->curve[k];
        const uint32_t *point = c->point + c->first[k], *patch = patches->curve_patch + curve->patch_first;
        const size_t points = c->first[k + 1] - c->first[k];
        for (size_t i = 0; i < (points - !curve->closed) * curve->patch_count && points > 1; i++) {
            const size_t at = i / curve->patch_count;
            const curve_point from = {point[at], patch[i % curve->patch_count], 0},
                              to = {point[(at + 1) % points], from.patch, 0}, *a, *b;
            a = bsearch(&from, list, known, sizeof *list, compare_curve_points);
            b = bsearch(&to, list, known, sizeof *list, compare_curve_points);
            if (!a || !b || is_jump(patches, patch_points, a->index, b->index)) continue;
            side[*count][0] = a->index;
            side[(*count)++][1] = b->index;
        }
    }
    free(list);
    return side;
}

uint32_t (*curve_chains_steps(const field_patches *patches, const solver_points *solved, size_t *count))[2]
{
    curve_chains chains;
    curve_chains_make(patches, solved, &chains);
    uint32_t(*side)[2] = curve_chains_sides(&chains, patches, &solved->patch_points, count);
    curve_chains_free(&chains);
    return side;
}
