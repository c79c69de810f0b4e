// SPDX-License-Identifier: Apache-2.0
#include "geometry/space/point_tree.h"

#include <assert.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/space/bbox.h"

/* Maximum points of a leaf: searching all of them takes no longer than dividing them. */
enum { LEAF = 8 };

struct point_tree {
    const vec3 *points;
    size_t count;
    uint32_t *order; /* the points of each range, partitioned: those below the median along the axis of the
                      * range, the median, and those above */
    uint8_t *axis;   /* per median: the axis of its range */
};

static void swap(uint32_t *a, uint32_t *b)
{
    uint32_t held = *a;
    *a = *b;
    *b = held;
}

/* Puts the point of rank `middle` in its place, smaller ones before it (Hoare 1961). */
static void divide(const vec3 *points, uint32_t *order, size_t count, size_t middle, int axis)
{
    size_t low = 0, high = count;
    while (high - low > 1) {
        double pivot = vec3_get(points[order[low + (high - low) / 2]], axis);
        size_t i = low, j = high - 1;
        for (;; i++, j--) {
            while (vec3_get(points[order[i]], axis) < pivot) i++;
            while (vec3_get(points[order[j]], axis) > pivot) j--;
            if (i >= j) break;
            swap(&order[i], &order[j]);
        }
        if (middle < i)
            high = i;
        else if (i > low)
            low = i;
        else
            low++; /* the item at `middle` is the smallest of the range */
    }
}

int point_tree_halve(const vec3 *points, uint32_t *order, size_t count)
{
    bbox box = bbox_empty();
    for (size_t k = 0; k < count; k++) box = bbox_include(box, points[order[k]]);
    vec3 side = vec3_sub(box.max, box.min);
    int axis = side.x >= side.y && side.x >= side.z ? 0 : side.y >= side.z ? 1 : 2;
    divide(points, order, count, count / 2, axis);
    return axis;
}

static void build(point_tree *n, size_t low, size_t high)
{
    while (high - low > LEAF) {
        size_t middle = low + (high - low) / 2;
        n->axis[middle] = (uint8_t)point_tree_halve(n->points, n->order + low, high - low);
        build(n, low, middle);
        low = middle + 1;
    }
}

point_tree *point_tree_new(const vec3 *points, size_t count, error *e)
{
    assert(count > 0 && count < UINT32_MAX);
    point_tree *n = mem_alloc(sizeof *n);
    n->points = points;
    n->count = count;
    n->order = mem_array(count, sizeof *n->order, "the search for near points", e);
    n->axis = mem_array(count, sizeof *n->axis, "the search for near points", e);
    if (!n->order || !n->axis) {
        point_tree_free(n);
        return NULL;
    }
    for (size_t k = 0; k < count; k++) n->order[k] = (uint32_t)k;
    build(n, 0, count);
    return n;
}

void point_tree_free(point_tree *n)
{
    if (!n) return;
    free(n->order);
    free(n->axis);
    free(n);
}

typedef struct search {
    vec3 x;
    double enough2, best2;
    uint32_t best;
} search;

static void consider(const point_tree *n, size_t k, search *s)
{
    double d2 = vec3_norm2(vec3_sub(n->points[n->order[k]], s->x));
    if (d2 >= s->best2) return;
    s->best2 = d2;
    s->best = n->order[k];
}

static void look(const point_tree *n, size_t low, size_t high, search *s)
{
    if (high - low <= LEAF) {
        for (size_t k = low; k < high; k++) consider(n, k, s);
        return;
    }
    size_t middle = low + (high - low) / 2;
    double beyond = vec3_get(s->x, n->axis[middle]) - vec3_get(n->points[n->order[middle]], n->axis[middle]);
    look(n, beyond < 0 ? low : middle + 1, beyond < 0 ? middle : high, s);
    if (s->best2 <= s->enough2 || beyond * beyond >= s->best2) return;
    consider(n, middle, s);
    look(n, beyond < 0 ? middle + 1 : low, beyond < 0 ? high : middle, s);
}

uint32_t point_tree_nearest(const point_tree *n, vec3 x, double enough, double *distance)
{
    search s = {x, enough * fabs(enough), INFINITY, 0};
    look(n, 0, n->count, &s);
    *distance = sqrt(s.best2);
    return s.best;
}

typedef struct visit_job {
    const point_tree *tree;
    vec3 x;
    double reach2;
    point_tree_visit visit;
    void *context;
} visit_job;

static void visit_range(const visit_job *job, size_t low, size_t high)
{
    const point_tree *n = job->tree;
    if (high - low <= LEAF) {
        for (size_t k = low; k < high; k++)
            if (vec3_norm2(vec3_sub(n->points[n->order[k]], job->x)) <= job->reach2)
                job->visit(job->context, n->order[k]);
        return;
    }
    const size_t middle = low + (high - low) / 2;
    const double beyond =
        vec3_get(job->x, n->axis[middle]) - vec3_get(n->points[n->order[middle]], n->axis[middle]);
    const bool is_across = beyond * beyond <= job->reach2;
    if (beyond <= 0 || is_across) visit_range(job, low, middle);
    if (is_across) visit_range(job, middle, middle + 1);
    if (beyond >= 0 || is_across) visit_range(job, middle + 1, high);
}

void point_tree_within(const point_tree *n, vec3 x, double reach, point_tree_visit visit, void *context)
{
    visit_range(&(visit_job){n, x, reach * reach, visit, context}, 0, n->count);
}
