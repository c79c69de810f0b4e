#include "solver/particles/coverage.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "field/patches.h"
#include "field/projection.h"
#include "geometry/cell_list.h"

/* "Cell" in this file: a grid cell of the surface. */

/* Maximum number of tasks of the cells. Each has its own largest distance. */
enum { MAX_TASKS = 256 };
/* Minimum number of cells of a task. With fewer, most are tested before a large distance is known that skips cells. */
enum { MIN_TASK_CELLS = 1024 };
/* Minimum number of cells for all threads: about one millisecond of work. */
enum { MIN_PARALLEL_CELLS = 20000 };
/* One of this number of cells is tested in a first pass: the largest distance found skips most cells of the second. */
enum { SUBSET_STEP = 16 };

/* Number of recently found points that a place is tested against before a search. */
enum { RECENT_POINTS = 4 };

/* Ratio of largest to least spacing beyond which a lower bound of the spacing is kept per bin. */
static const double GRADED_RATIO = 1.25;
/* Maximum number of bins along an axis: limits the memory. */
enum { MAX_BINS = 64 };
/* Maximum number of bins per point. */
static const double BINS_PER_POINT = 2;
/* Relative margin of the bin width: rounding cannot put a point two bins away. */
static const double BIN_MARGIN = 1e-6;

/* Lower bounds of the spacing of the points near a place. */
typedef struct spacings {
    double all;   /* the least spacing of all points */
    double reach; /* distance for which the bound of a bin holds */
    double over;  /* bins per length */
    vec3 origin;
    int bins[3];
    double *near; /* per bin: the least spacing in it and its 26 neighbours; NULL: `all` everywhere */
} spacings;

typedef struct coverage_job {
    const surface *scan;
    cell_list *points;
    const vec3 *position;
    const double *spacing;
    spacings least;
    size_t first; /* cell */
    size_t step;  /* between cells */
    size_t grain;
    double known; /* only larger distances are searched */
    double farthest[MAX_TASKS];
} coverage_job;

static int clamped_bin(const spacings *s, vec3 x, int axis)
{
    const double at = (vec3_get(x, axis) - vec3_get(s->origin, axis)) * s->over;
    return at < 0 ? -1 : at >= s->bins[axis] ? s->bins[axis] : (int)at;
}

/* Replaces each bin by the minimum of it and its two neighbours along an axis. `stride`: index distance along the axis. */
static void minimum_filter(spacings *s, int axis, size_t stride)
{
    const size_t total = (size_t)s->bins[0] * (size_t)s->bins[1] * (size_t)s->bins[2];
    const size_t along = stride * (size_t)s->bins[axis];
    for (size_t line = 0; line < total; line++) {
        if (line % along >= stride) continue; /* not the first bin of a line along the axis */
        double before = INFINITY;
        for (size_t at = line; at < line + along; at += stride) {
            const double own = s->near[at],
                         next = at + stride < line + along ? s->near[at + stride] : INFINITY;
            s->near[at] = fmin(own, fmin(before, next));
            before = own;
        }
    }
}

static bool find_spacings(const vec3 *position, const double *spacing, size_t count, spacings *out, error *e)
{
    double least = INFINITY, largest = 0;
    for (size_t i = 0; i < count; i++) { /* fmin would be a function call */
        least = spacing[i] < least ? spacing[i] : least;
        largest = spacing[i] > largest ? spacing[i] : largest;
    }
    *out = (spacings){.all = least};
    if (!(largest > GRADED_RATIO * least)) return true;
    bbox box = bbox_of_points(position, count, NULL);
    const double most = fmin(fmax(1, cbrt(BINS_PER_POINT * (double)count)), MAX_BINS);
    out->reach = fmax(largest, bbox_longest(box) / most);
    out->over = 1 / ((1 + BIN_MARGIN) * out->reach);
    box = bbox_grow(box, out->reach);
    out->origin = box.min;
    for (int a = 0; a < 3; a++) out->bins[a] = (int)(vec3_get(bbox_size(box), a) * out->over) + 1;
    const size_t total = (size_t)out->bins[0] * (size_t)out->bins[1] * (size_t)out->bins[2];
    out->near = mem_array(total, sizeof *out->near, "the search for near points", e);
    for (size_t k = 0; out->near && k < total; k++) out->near[k] = INFINITY;
    for (size_t i = 0; out->near && i < count; i++) {
        const int x = clamped_bin(out, position[i], 0), y = clamped_bin(out, position[i], 1),
                  z = clamped_bin(out, position[i], 2);
        double *bin =
            &out->near[((size_t)z * (size_t)out->bins[1] + (size_t)y) * (size_t)out->bins[0] + (size_t)x];
        *bin = fmin(*bin, spacing[i]);
    }
    size_t stride = 1;
    for (int a = 0; out->near && a < 3; stride *= (size_t)out->bins[a++]) minimum_filter(out, a, stride);
    return out->near != NULL;
}

/* Returns a distance d: if a point is within d of x, every place within `radius` of x is within `farthest` spacings of its
 * nearest point. d <= 0: no such distance exists. */
static double covering_distance(const spacings *s, vec3 x, double radius, double farthest)
{
    const double anywhere = farthest * s->all - radius;
    if (!s->near) return anywhere;
    int at[3];
    for (int a = 0; a < 3; a++) {
        at[a] = clamped_bin(s, x, a);
        if (at[a] < 0 || at[a] == s->bins[a]) return anywhere;
    }
    const double least =
        s->near[((size_t)at[2] * (size_t)s->bins[1] + (size_t)at[1]) * (size_t)s->bins[0] + (size_t)at[0]];
    /* the nearest point of such a place is within d + 2 radius of x */
    return fmax(anywhere, fmin(farthest * least - radius, s->reach - 2 * radius));
}

/* Projects a place onto the surface. A triangle of a cell larger than the spacing may be far from the surface. If the projection
 * fails, the place is bisected in its cell (not with patches). False: the result lies beyond the boundary of an open surface. */
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

/* Whether a point lies within `within` > 0 of x. Tests the recently found points first, since consecutive cells are near the same
 * points; a point found by the search is added to them. */
static bool has_point(const coverage_job *job, vec3 x, double within, uint32_t near[RECENT_POINTS])
{
    if (!(within > 0)) return false;
    for (int k = 0; k < RECENT_POINTS; k++)
        if (vec3_norm2(vec3_sub(job->position[near[k]], x)) <= within * within) return true;
    double distance;
    const uint32_t found = cell_list_nearest(job->points, x, within, &distance);
    memmove(near + 1, near, (RECENT_POINTS - 1) * sizeof *near);
    near[0] = found;
    return distance <= within;
}

typedef struct cell_test {
    size_t cell;
    vec3 triangle[FIELD_CELL_TRIANGLES][3];
    int count;
    double size;  /* of the cell; set if !is_done */
    bool is_done; /* the test of the cell's middle shows that all its places are covered */
} cell_test;

/* Tests the middle of cell k. A cell of one triangle has one place, so that the test of the middle saves nothing. */
static void test_cell(const coverage_job *job, size_t k, double farthest, uint32_t near[RECENT_POINTS],
                      cell_test *out)
{
    const field *f = job->scan->field;
    out->cell = k;
    out->count = f->ops->cell_triangles ? surface_cell_rough_triangles(job->scan, k, out->triangle) : -1;
    out->is_done = out->count == 0;
    out->size = f->cell_size;
    if (out->count == 1 && !f->uneven) return;
    double radius;
    const vec3 middle = surface_cell_middle(job->scan, k, &radius);
    out->is_done = has_point(job, middle, covering_distance(&job->least, middle, radius, farthest), near);
    if (out->is_done) return;
    if (f->uneven) {
        field_cell cell;
        surface_cell(job->scan, k, &cell);
        out->size = field_cell_size(f, &cell);
    }
    if (out->count < 0) out->count = surface_cell_rough_triangles(job->scan, k, out->triangle);
}

/* The maximum of `farthest` and the distances of the places of a cell. */
static double farthest_place(const coverage_job *job, const cell_test *test, double farthest,
                             uint32_t near[RECENT_POINTS])
{
    const field *f = job->scan->field;
    for (int i = 0; i < test->count; i++) {
        vec3 x = field_triangle_middle(test->triangle[i]);
        if (f->open && !bbox_contains(f->domain, x)) continue;
        double distance;
        if (has_point(job, x, covering_distance(&job->least, x, 0, farthest), near) ||
            !project_place(job->scan, test->cell, test->size, &x))
            continue;
        uint32_t point =
            cell_list_nearest(job->points, x, covering_distance(&job->least, x, 0, farthest), &distance);
        farthest = fmax(farthest, distance / job->spacing[point]);
    }
    return farthest;
}

/* A group of consecutive cells that ends before cell `end`. is_done: the test of its middle shows that all places are covered. */
typedef struct group_test {
    size_t end;
    bool is_done;
} group_test;

/* Whether the test of the group of cell k shows that the cell is covered. */
static bool is_done_by_group(const coverage_job *job, size_t k, double farthest, uint32_t near[RECENT_POINTS],
                             group_test *group)
{
    vec3 middle;
    double radius;
    if (k >= group->end)
        group->is_done =
            surface_cell_group(job->scan, k, &group->end, &middle, &radius) &&
            has_point(job, middle, covering_distance(&job->least, middle, radius, farthest), near);
    return group->is_done;
}

static void cells_chunk(void *context, int worker, size_t begin, size_t end)
{
    coverage_job *job = context;
    double farthest = job->known;
    uint32_t near[RECENT_POINTS] = {0};
    group_test group = {0};
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        const size_t k = job->first + n * job->step;
        if (is_done_by_group(job, k, farthest, near, &group)) continue;
        if (!(surface_cell_area(job->scan, k) > 0)) continue;
        cell_test test;
        test_cell(job, k, farthest, near, &test);
        if (!test.is_done) farthest = farthest_place(job, &test, farthest, near);
    }
    job->farthest[begin / job->grain] = farthest;
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

/* The maximum of `known` and the distances of every `step`-th cell of [begin, end). */
static double measure_cells(coverage_job *job, size_t begin, size_t end, size_t step, double known,
                            threads *pool)
{
    const size_t cells = (end - begin + step - 1) / step;
    job->first = begin;
    job->step = step;
    job->known = known;
    job->grain = cells / MAX_TASKS + 1;
    if (job->grain < MIN_TASK_CELLS) job->grain = MIN_TASK_CELLS;
    memset(job->farthest, 0, sizeof job->farthest);
    threads_run(pool, cells, job->grain, cells_chunk, job);
    for (int k = 0; k < MAX_TASKS; k++) known = fmax(known, job->farthest[k]);
    return known;
}

/* Tests a subset of the cells first (SUBSET_STEP), then all. */
static double measure_part(coverage_job *job, size_t begin, size_t end, double known, threads *pool)
{
    if (end - begin > SUBSET_STEP * MIN_TASK_CELLS)
        known = measure_cells(job, begin, end, SUBSET_STEP, known, pool);
    return measure_cells(job, begin, end, 1, known, pool);
}

bool coverage_measure(const surface *scan, const vec3 *position, const double *spacing, size_t count,
                      threads *pool, double *farthest, error *e)
{
    coverage_job job = {.scan = scan, .position = position, .spacing = spacing};
    if (!find_spacings(position, spacing, count, &job.least, e)) return false;
    if (!(job.points = cell_list_new(position, count, pool, e))) {
        free(job.least.near);
        return false;
    }
    const bool narrow = threads_narrow(pool, scan->cells < MIN_PARALLEL_CELLS);
    for (size_t k = 0; k < coverage_parts(scan); k++)
        farthest[k] =
            measure_part(&job, first_of_part(scan, k), first_of_part(scan, k + 1), farthest[k], pool);
    threads_narrow(pool, narrow);
    cell_list_free(job.points);
    free(job.least.near);
    return !threads_stopped(pool) || error_set(e, ERROR_CANCELLED, "stopped");
}

static bool add_place(coverage_gaps *p, vec3 x, uint32_t patch, error *e)
{
    const char *what = "the gaps in coverage";
    vec3 *place = mem_grow(p->place, p->count, &p->place_capacity, sizeof *place, what, e);
    if (!place) return false;
    p->place = place;
    uint32_t *of = mem_grow(p->patch, p->count, &p->patch_capacity, sizeof *of, what, e);
    if (!of) return false;
    p->patch = of;
    p->place[p->count] = x;
    p->patch[p->count++] = patch;
    return true;
}

/* Appends the uncovered places of a cell. */
static bool add_places(const coverage_job *job, const cell_test *test, uint32_t patch, double limit,
                       uint32_t near[RECENT_POINTS], coverage_gaps *out, error *e)
{
    const field *f = job->scan->field;
    for (int i = 0; i < test->count; i++) {
        vec3 x = field_triangle_middle(test->triangle[i]);
        double distance;
        if (f->open && !bbox_contains(f->domain, x)) continue;
        if (has_point(job, x, covering_distance(&job->least, x, 0, limit), near)) continue;
        if (!f->patches && !project_place(job->scan, test->cell, test->size, &x)) continue;
        const uint32_t point = cell_list_nearest(job->points, x, 0, &distance);
        if (distance > limit * job->spacing[point] && !add_place(out, x, patch, e)) return false;
    }
    return true;
}

bool coverage_find_gaps(const surface *scan, const vec3 *position, const double *spacing, size_t count,
                        double limit, coverage_gaps *out, error *e)
{
    coverage_job job = {.scan = scan, .position = position, .spacing = spacing};
    uint32_t near[RECENT_POINTS] = {0};
    *out = (coverage_gaps){0};
    if (!find_spacings(position, spacing, count, &job.least, e)) return false;
    bool ok = (job.points = cell_list_new(position, count, NULL, e)) != NULL;
    for (uint32_t patch = 0; ok && patch < coverage_parts(scan); patch++)
        for (size_t k = first_of_part(scan, patch); ok && k < first_of_part(scan, patch + 1); k++) {
            if (!(surface_cell_area(scan, k) > 0)) continue;
            cell_test test;
            test_cell(&job, k, limit, near, &test);
            if (!test.is_done) ok = add_places(&job, &test, patch, limit, near, out, e);
        }
    cell_list_free(job.points);
    free(job.least.near);
    return ok;
}

void coverage_gaps_free(coverage_gaps *p)
{
    free(p->place);
    free(p->patch);
    *p = (coverage_gaps){0};
}
