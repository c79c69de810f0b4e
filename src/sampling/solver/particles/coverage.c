// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/particles/coverage.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "surface/field/patches.h"
#include "surface/field/projection.h"
#include "geometry/space/cell_list.h"

/* "Cell" in this file: a grid cell of the surface. */

typedef struct coverage_job {
    const surface *scan;
    cell_list *points;
    const vec3 *position;
    const double *spacing;
    double least_spacing; /* of all points */
    size_t first;         /* cell of the part that is measured */
    /* Of each worker: its largest distance, and the last point that it has found. */
    double farthest[THREADS_MAX];
    uint32_t last[THREADS_MAX];
} coverage_job;

static double least_of(const double *spacing, size_t count)
{
    double least = INFINITY;
    for (size_t i = 0; i < count; i++)
        least = spacing[i] < least ? spacing[i] : least; /* fmin would be a function call */
    return least;
}

/* Returns a distance d: if a point is within d of x, every place within `radius` of x is within `farthest`
 * spacings of its nearest point. d <= 0: no such distance exists. */
static double covering_distance(const coverage_job *job, double radius, double farthest)
{
    return farthest * job->least_spacing - radius;
}

/* Projects a place onto the surface. A triangle of a cell larger than the spacing may be far from the
 * surface. If the projection fails, the place is bisected in its cell (not with patches). False: the
 * result lies beyond the boundary of an open surface. */
static bool project_place(const surface *scan, size_t k, double cell_size, vec3 *x)
{
    const field *f = scan->field;
    const projection_limits limits = projection_draft(cell_size);
    vec3 p = *x, normal;
    if (projection_find(f, &limits, &p, &normal) && vec3_norm(vec3_sub(p, *x)) < cell_size)
        *x = p;
    else if (!f->patches)
        *x = surface_bisect(scan, k, *x);
    return !f->open || bbox_contains(f->domain, *x);
}

/* Whether a point lies within `within` > 0 of x. Tests the last found point first, since consecutive cells
 * are near the same points. */
static bool has_point(const coverage_job *job, vec3 x, double within, uint32_t *last)
{
    if (!(within > 0)) return false;
    if (vec3_norm2(vec3_sub(job->position[*last], x)) <= within * within) return true;
    double distance;
    *last = cell_list_nearest(job->points, x, within, &distance);
    return distance <= within;
}

typedef struct cell_test {
    size_t cell;
    vec3 triangle[FIELD_CELL_TRIANGLES][3];
    int count;
    double size;  /* of the cell; set if !is_done */
    bool is_done; /* the test of the cell's middle shows that all its places are covered */
} cell_test;

/* Tests the middle of cell k. A cell of one triangle has one place, so that the test of the middle saves
 * nothing. */
static void test_cell(const coverage_job *job, size_t k, double farthest, uint32_t *last, cell_test *out)
{
    const field *f = job->scan->field;
    out->cell = k;
    out->count = f->ops->cell_triangles ? surface_cell_rough_triangles(job->scan, k, out->triangle) : -1;
    out->is_done = out->count == 0;
    out->size = f->cell_size;
    if (out->count == 1 && !f->uneven) return;
    double radius;
    const vec3 middle = surface_cell_middle(job->scan, k, &radius);
    out->is_done = has_point(job, middle, covering_distance(job, radius, farthest), last);
    if (out->is_done) return;
    if (f->uneven) {
        field_cell cell;
        surface_cell(job->scan, k, &cell);
        out->size = field_cell_size(f, &cell);
    }
    if (out->count < 0) out->count = surface_cell_rough_triangles(job->scan, k, out->triangle);
}

/* The maximum of `farthest` and the distances of the places of a cell. */
static double farthest_place(const coverage_job *job, const cell_test *test, double farthest, uint32_t *last)
{
    const field *f = job->scan->field;
    for (int i = 0; i < test->count; i++) {
        vec3 x = field_triangle_middle(test->triangle[i]);
        if (f->open && !bbox_contains(f->domain, x)) continue;
        double distance;
        if (has_point(job, x, covering_distance(job, 0, farthest), last) ||
            !project_place(job->scan, test->cell, test->size, &x))
            continue;
        uint32_t point = cell_list_nearest(job->points, x, covering_distance(job, 0, farthest), &distance);
        farthest = fmax(farthest, distance / job->spacing[point]);
    }
    return farthest;
}

/* A group of consecutive cells that ends before cell `end`. is_done: the test of its middle shows that all
 * places are covered. */
typedef struct group_test {
    size_t end;
    bool is_done;
} group_test;

/* Whether the test of the group of cell k shows that the cell is covered. */
static bool is_done_by_group(const coverage_job *job, size_t k, double farthest, uint32_t *last,
                             group_test *group)
{
    vec3 middle;
    double radius;
    if (k >= group->end)
        group->is_done = surface_cell_group(job->scan, k, &group->end, &middle, &radius) &&
                         has_point(job, middle, covering_distance(job, radius, farthest), last);
    return group->is_done;
}

static void cells_chunk(void *context, int worker, size_t begin, size_t end)
{
    coverage_job *job = context;
    double *farthest = &job->farthest[worker];
    uint32_t *last = &job->last[worker];
    group_test group = {0};
    for (size_t k = job->first + begin; k < job->first + end; k++) {
        if (is_done_by_group(job, k, *farthest, last, &group)) continue;
        if (!(surface_cell_area(job->scan, k) > 0)) continue;
        cell_test test;
        test_cell(job, k, *farthest, last, &test);
        if (!test.is_done) *farthest = farthest_place(job, &test, *farthest, last);
    }
}

size_t coverage_parts(const surface *scan)
{
    return scan->field->patches ? scan->field->patches->count : 1;
}

/* The first cell of a part; for part = coverage_parts the number of cells. */
static size_t first_of_part(const surface *scan, size_t part)
{
    return scan->field->patches ? scan->parts.begin[part] : part * scan->cells;
}

bool coverage_measure(const surface *scan, const vec3 *position, const double *spacing, size_t count,
                      threads *pool, double *farthest, error *e)
{
    coverage_job job = {
        .scan = scan, .position = position, .spacing = spacing, .least_spacing = least_of(spacing, count)};
    if (!(job.points = cell_list_new(position, count, pool, e))) return false;
    for (size_t part = 0; part < coverage_parts(scan); part++) {
        job.first = first_of_part(scan, part);
        for (int k = 0; k < threads_count(pool); k++) job.farthest[k] = farthest[part];
        threads_run(pool, first_of_part(scan, part + 1) - job.first, THREADS_GRAIN, cells_chunk, &job);
        for (int k = 0; k < threads_count(pool); k++) farthest[part] = fmax(farthest[part], job.farthest[k]);
    }
    cell_list_free(job.points);
    return threads_may_go_on(pool, e);
}

static bool add_place(coverage_gaps *p, vec3 x, uint32_t patch, error *e)
{
    const char *what = "the gaps in coverage";
    if (!MEM_GROW(p->place, p->count, &p->place_capacity, what, e)) return false;
    if (!MEM_GROW(p->patch, p->count, &p->patch_capacity, what, e)) return false;
    p->place[p->count] = x;
    p->patch[p->count++] = patch;
    return true;
}

/* Appends the uncovered places of a cell. */
static bool add_places(const coverage_job *job, const cell_test *test, uint32_t patch, double limit,
                       uint32_t *last, coverage_gaps *out, error *e)
{
    const field *f = job->scan->field;
    for (int i = 0; i < test->count; i++) {
        vec3 x = field_triangle_middle(test->triangle[i]);
        double distance;
        if (f->open && !bbox_contains(f->domain, x)) continue;
        if (has_point(job, x, covering_distance(job, 0, limit), last)) continue;
        if (!f->patches && !project_place(job->scan, test->cell, test->size, &x)) continue;
        const uint32_t point = cell_list_nearest(job->points, x, 0, &distance);
        if (distance > limit * job->spacing[point] && !add_place(out, x, patch, e)) return false;
    }
    return true;
}

bool coverage_find_gaps(const surface *scan, const vec3 *position, const double *spacing, size_t count,
                        double limit, coverage_gaps *out, error *e)
{
    coverage_job job = {
        .scan = scan, .position = position, .spacing = spacing, .least_spacing = least_of(spacing, count)};
    uint32_t last = 0;
    *out = (coverage_gaps){0};
    bool ok = (job.points = cell_list_new(position, count, NULL, e)) != NULL;
    for (uint32_t patch = 0; ok && patch < coverage_parts(scan); patch++)
        for (size_t k = first_of_part(scan, patch); ok && k < first_of_part(scan, patch + 1); k++) {
            if (!(surface_cell_area(scan, k) > 0)) continue;
            cell_test test;
            test_cell(&job, k, limit, &last, &test);
            if (!test.is_done) ok = add_places(&job, &test, patch, limit, &last, out, e);
        }
    cell_list_free(job.points);
    return ok;
}

void coverage_gaps_free(coverage_gaps *p)
{
    free(p->place);
    free(p->patch);
    *p = (coverage_gaps){0};
}
