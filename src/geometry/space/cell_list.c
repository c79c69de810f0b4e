// SPDX-License-Identifier: Apache-2.0
#include "geometry/space/cell_list.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/space/bbox.h"
#include "geometry/space/point_tree.h"

/* Maximum number of cells per point, and of cells along an axis. More: searches visit more empty cells.
 * Fewer: searches visit more points outside of their radius. */
enum { CELLS_PER_POINT = 2, AXIS_MOST = 4096 };
/* Points of a task of the thread pool. */
enum { CHUNK = 4096 };
/* The edge of the cells is multiplied by this factor until the number of cells is within the limits. */
static const double WIDER = 1.1;
/* If the mean number of points in the cell of a point exceeds this, a point_tree replaces the cells, since
 * each search would visit about as many points. */
static const double CROWD = 100;

static const char what[] = "the search for near points";

struct cell_list {
    const vec3 *points;
    vec3 origin;
    double edge, per_edge; /* of a cell; 1 / edge */
    int32_t cells[3];      /* along each axis */
    uint32_t *begin;       /* cell k has item[begin[k]] .. item[begin[k + 1] - 1], ascending */
    uint32_t *item;
    point_tree *tree; /* NULL: the points are not over-dense */
};

static size_t cells_of(vec3 size, double edge, int32_t cells[3])
{
    size_t total = 1;
    for (int a = 0; a < 3; a++) {
        cells[a] = (int32_t)(vec3_get(size, a) / edge) + 1;
        total *= (size_t)cells[a];
    }
    return total;
}

/* The cell of a place along an axis. A place outside the box has the nearest cell. */
static int32_t cell_along(const cell_list *l, vec3 x, int axis)
{
    const double at = (vec3_get(x, axis) - vec3_get(l->origin, axis)) * l->per_edge;
    return !(at > 0) ? 0 : at >= l->cells[axis] ? l->cells[axis] - 1 : (int32_t)at;
}

static size_t row_of(const cell_list *l, int32_t y, int32_t z)
{
    return ((size_t)z * (size_t)l->cells[1] + (size_t)y) * (size_t)l->cells[0];
}

static size_t cell_of(const cell_list *l, vec3 x)
{
    return row_of(l, cell_along(l, x, 1), cell_along(l, x, 2)) + (size_t)cell_along(l, x, 0);
}

typedef struct fill_job {
    cell_list *l;
    uint32_t *cell; /* of each point */
} fill_job;

/* Counts the points of cell k in begin[k + 1]. */
static void count_chunk(void *context, int worker, size_t begin, size_t end)
{
    const fill_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        job->cell[i] = (uint32_t)cell_of(job->l, job->l->points[i]);
        __atomic_fetch_add(&job->l->begin[job->cell[i] + 1], 1, __ATOMIC_RELAXED);
    }
}

/* Stores the points. Before, begin[k + 1] is the beginning of cell k; afterwards, it is the end. */
static void store_chunk(void *context, int worker, size_t begin, size_t end)
{
    const fill_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++)
        job->l->item[__atomic_fetch_add(&job->l->begin[job->cell[i] + 1], 1, __ATOMIC_RELAXED)] = (uint32_t)i;
}

/* Sorts the points of each cell: their order depends on the threads. */
static void sort_chunk(void *context, int worker, size_t begin, size_t end)
{
    const cell_list *l = context;
    (void)worker;
    for (size_t k = begin; k < end; k++)
        for (uint32_t from = l->begin[k] + 1; from < l->begin[k + 1]; from++) {
            const uint32_t item = l->item[from];
            uint32_t to = from;
            for (; to > l->begin[k] && l->item[to - 1] > item; to--) l->item[to] = l->item[to - 1];
            l->item[to] = item;
        }
}

/* Sorts the points by cell. False: they are over-dense, and are not sorted. */
static bool fill(cell_list *l, size_t count, size_t total, threads *pool, uint32_t *cell)
{
    fill_job job = {l, cell};
    double shared = 0;
    uint32_t sum = 0;
    threads_run(pool, count, CHUNK, count_chunk, &job);
    for (size_t k = 0; k < total; k++) {
        const uint32_t here = l->begin[k + 1];
        shared += (double)here * here;
        l->begin[k + 1] = sum;
        sum += here;
    }
    if (shared > CROWD * (double)count) return false;
    threads_run(pool, count, CHUNK, store_chunk, &job);
    if (threads_count(pool) > 1) threads_run(pool, total, CHUNK, sort_chunk, l);
    return true;
}

/* Chooses the edge of the cells. Returns the number of cells. */
static size_t choose_edge(cell_list *l, bbox box, size_t count)
{
    const vec3 size = bbox_size(box);
    const double longest = bbox_longest(box);
    const size_t wanted = CELLS_PER_POINT * count + 8, most = wanted < UINT32_MAX ? wanted : UINT32_MAX;
    size_t total;
    l->origin = box.min;
    l->edge = longest > 0 ? longest / AXIS_MOST : 1;
    while ((total = cells_of(size, l->edge, l->cells)) > most) l->edge *= WIDER;
    l->per_edge = 1 / l->edge;
    return total;
}

cell_list *cell_list_new(const vec3 *points, size_t count, threads *pool, error *e)
{
    assert(count > 0 && count < UINT32_MAX);
    cell_list *l = mem_alloc(sizeof *l);
    l->points = points;
    const size_t total = choose_edge(l, bbox_of_points(points, count, pool), count);
    l->begin = mem_array(total + 1, sizeof *l->begin, what, e);
    l->item = mem_array(count, sizeof *l->item, what, e);
    uint32_t *cell = mem_array(count, sizeof *cell, what, e);
    bool ok = l->begin && l->item && cell;
    const bool is_dense = ok && !fill(l, count, total, pool, cell);
    free(cell);
    ok = ok && threads_may_go_on(pool, e);
    if (ok && is_dense) {
        free(l->begin);
        free(l->item);
        l->begin = l->item = NULL;
        ok = (l->tree = point_tree_new(points, count, e)) != NULL;
    }
    if (ok) return l;
    cell_list_free(l);
    return NULL;
}

void cell_list_free(cell_list *l)
{
    if (!l) return;
    point_tree_free(l->tree);
    free(l->begin);
    free(l->item);
    free(l);
}

bool cell_list_is_dense(const cell_list *l)
{
    return l->tree != NULL;
}

typedef struct search {
    vec3 x;
    int32_t at[3]; /* the cell of x */
    double best2;
    uint32_t best;
} search;

/* Searches the cells `low` to `high` of a row, as far as they exist. */
static void search_row(const cell_list *l, size_t row, int32_t low, int32_t high, search *s)
{
    if (low < 0) low = 0;
    if (high > l->cells[0] - 1) high = l->cells[0] - 1;
    if (low > high) return;
    const uint32_t end = l->begin[row + (size_t)high + 1];
    for (uint32_t k = l->begin[row + (size_t)low]; k < end; k++) {
        const double d2 = vec3_norm2(vec3_sub(l->points[l->item[k]], s->x));
        if (d2 >= s->best2) continue;
        s->best2 = d2;
        s->best = l->item[k];
    }
}

/* Searches the cells whose largest distance from the cell of x along an axis is `ring`, in cells. */
static void search_ring(const cell_list *l, int32_t ring, search *s)
{
    for (int32_t z = s->at[2] - ring; z <= s->at[2] + ring; z++)
        for (int32_t y = s->at[1] - ring; z >= 0 && z < l->cells[2] && y <= s->at[1] + ring; y++) {
            if (y < 0 || y >= l->cells[1]) continue;
            const size_t row = row_of(l, y, z);
            if (abs(z - s->at[2]) == ring || abs(y - s->at[1]) == ring)
                search_row(l, row, s->at[0] - ring, s->at[0] + ring, s);
            else {
                search_row(l, row, s->at[0] - ring, s->at[0] - ring, s);
                search_row(l, row, s->at[0] + ring, s->at[0] + ring, s);
            }
        }
}

/* A lower bound of the distance of the points beyond a ring; INFINITY: there are no cells beyond it. */
static double distance_beyond(const cell_list *l, int32_t ring, const search *s)
{
    double least = INFINITY;
    for (int a = 0; a < 3; a++) {
        const double at = vec3_get(s->x, a) - vec3_get(l->origin, a);
        if (s->at[a] - ring > 0) least = fmin(least, at - (s->at[a] - ring) * l->edge);
        if (s->at[a] + ring < l->cells[a] - 1) least = fmin(least, (s->at[a] + ring + 1) * l->edge - at);
    }
    return least;
}

/* In edges: rounding may put a point that is this near to a neighbouring cell into that cell. */
static const double ROUNDING = 1e-9;

/* Any point within `reach` of x, in the few cells that `reach` spans. False: there is none. */
static bool find_any(const cell_list *l, vec3 x, double reach, search *out)
{
    const double reach2 = reach * reach;
    const vec3 from = vec3_sub(x, (vec3){reach, reach, reach}), to = vec3_add(x, (vec3){reach, reach, reach});
    const int32_t low = cell_along(l, from, 0), high = cell_along(l, to, 0), last_y = cell_along(l, to, 1),
                  last_z = cell_along(l, to, 2);
    for (int32_t z = cell_along(l, from, 2); z <= last_z; z++)
        for (int32_t y = cell_along(l, from, 1); y <= last_y; y++) {
            const size_t row = row_of(l, y, z);
            const uint32_t end = l->begin[row + (size_t)high + 1];
            for (uint32_t k = l->begin[row + (size_t)low]; k < end; k++) {
                out->best = l->item[k];
                out->best2 = vec3_norm2(vec3_sub(l->points[out->best], x));
                if (out->best2 <= reach2) return true;
            }
        }
    return false;
}

uint32_t cell_list_nearest(const cell_list *l, vec3 x, double enough, double *distance)
{
    if (l->tree) return point_tree_nearest(l->tree, x, enough, distance);
    search s = {.x = x, .best2 = INFINITY};
    if (enough > 0 && enough < l->edge && find_any(l, x, enough, &s)) {
        *distance = sqrt(s.best2);
        return s.best;
    }
    s.best2 = INFINITY;
    const double enough2 = enough * fabs(enough);
    for (int a = 0; a < 3; a++) s.at[a] = cell_along(l, x, a);
    for (int32_t ring = 0;; ring++) {
        search_ring(l, ring, &s);
        if (s.best2 <= enough2) break;
        const double beyond = distance_beyond(l, ring, &s) - ROUNDING * l->edge;
        if (!(beyond < INFINITY) || (beyond > 0 && s.best2 <= beyond * beyond)) break;
    }
    *distance = sqrt(s.best2);
    return s.best;
}

void cell_list_within(const cell_list *l, vec3 x, double reach, cell_list_visit visit, void *context)
{
    if (l->tree) {
        point_tree_within(l->tree, x, reach, visit, context);
        return;
    }
    const double wide = reach + ROUNDING * l->edge, reach2 = reach * reach;
    const vec3 from = vec3_sub(x, (vec3){wide, wide, wide}), to = vec3_add(x, (vec3){wide, wide, wide});
    for (int32_t z = cell_along(l, from, 2); z <= cell_along(l, to, 2); z++)
        for (int32_t y = cell_along(l, from, 1); y <= cell_along(l, to, 1); y++) {
            const size_t row = row_of(l, y, z);
            const uint32_t end = l->begin[row + (size_t)cell_along(l, to, 0) + 1];
            for (uint32_t k = l->begin[row + (size_t)cell_along(l, from, 0)]; k < end; k++)
                if (vec3_norm2(vec3_sub(l->points[l->item[k]], x)) <= reach2) visit(context, l->item[k]);
        }
}

/* ---- moving points */

struct moving_cell_list {
    const vec3 *points;
    const uint32_t *moving;
    size_t moving_count;
    vec3 *fixed;      /* the points that do not move */
    cell_list *cells; /* cell list of `fixed`; NULL: all points move */
};

moving_cell_list *moving_cell_list_new(const vec3 *points, size_t count, const uint32_t *moving,
                                       size_t moving_count, threads *pool, error *e)
{
    moving_cell_list *m = mem_alloc(sizeof *m);
    size_t next = 0, fixed = 0;
    *m = (moving_cell_list){points, moving, moving_count,
                            mem_array(count - moving_count, sizeof *m->fixed, what, e), NULL};
    for (size_t i = 0; m->fixed && i < count; i++)
        if (next < moving_count && moving[next] == i)
            next++;
        else
            m->fixed[fixed++] = points[i];
    assert(!m->fixed || fixed + moving_count == count);
    if (m->fixed && (fixed == 0 || (m->cells = cell_list_new(m->fixed, fixed, pool, e)))) return m;
    moving_cell_list_free(m);
    return NULL;
}

void moving_cell_list_free(moving_cell_list *m)
{
    if (!m) return;
    cell_list_free(m->cells);
    free(m->fixed);
    free(m);
}

double moving_cell_list_nearest2(const moving_cell_list *m, vec3 x, uint32_t except)
{
    double nearest2 = INFINITY, distance;
    if (m->cells) nearest2 = vec3_norm2(vec3_sub(x, m->fixed[cell_list_nearest(m->cells, x, 0, &distance)]));
    for (size_t k = 0; k < m->moving_count; k++)
        if (m->moving[k] != except) {
            const double other2 = vec3_norm2(vec3_sub(x, m->points[m->moving[k]]));
            nearest2 = other2 < nearest2 ? other2 : nearest2;
        }
    return nearest2;
}
