#include "geometry/point_bins.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "geometry/bbox.h"

/* Maximum number of bins per point, and along an axis. */
enum { BINS_PER_POINT = 2, AXIS_MOST = 4096 };
/* Points in a chunk of work. */
enum { CHUNK = 4096 };
/* Edges of bins are tried from the smallest; each is WIDER times the previous one. */
static const double WIDER = 1.1;
/* Number of points in a point's bin, averaged over all points, above which point_bins_are_dense is true. */
static const double MOST_SHARED = 100;

struct point_bins {
    const vec3 *points;
    vec3 origin;
    double edge, over;
    int32_t bins[3];
    uint32_t *begin; /* of each bin its points in `item`; and the end */
    uint32_t *item;
    bool dense;
};

static size_t bins_of(vec3 size, double edge, int32_t bins[3])
{
    size_t total = 1;
    for (int a = 0; a < 3; a++) {
        bins[a] = (int32_t)(vec3_get(size, a) / edge) + 1;
        total *= (size_t)bins[a];
    }
    return total;
}

/* The bin of a place along an axis; of one beyond the box, the last before it. */
static int32_t bin_along(const point_bins *b, vec3 x, int axis)
{
    const double at = (vec3_get(x, axis) - vec3_get(b->origin, axis)) * b->over;
    return !(at > 0) ? 0 : at >= b->bins[axis] ? b->bins[axis] - 1 : (int32_t)at;
}

static size_t row_of(const point_bins *b, int32_t y, int32_t z)
{
    return ((size_t)z * (size_t)b->bins[1] + (size_t)y) * (size_t)b->bins[0];
}

static size_t bin_of(const point_bins *b, vec3 x)
{
    return row_of(b, bin_along(b, x, 1), bin_along(b, x, 2)) + (size_t)bin_along(b, x, 0);
}

typedef struct bins_job {
    point_bins *b;
    uint32_t *bin; /* of each point */
} bins_job;

/* Counts the points of bin k in begin[k + 1]. */
static void find_chunk(void *context, int worker, size_t begin, size_t end)
{
    const bins_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        job->bin[i] = (uint32_t)bin_of(job->b, job->b->points[i]);
        __atomic_fetch_add(&job->b->begin[job->bin[i] + 1], 1, __ATOMIC_RELAXED);
    }
}

/* Where bin k begins is in begin[k + 1] before, where it ends is there after. */
static void put_chunk(void *context, int worker, size_t begin, size_t end)
{
    const bins_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++)
        job->b->item[__atomic_fetch_add(&job->b->begin[job->bin[i] + 1], 1, __ATOMIC_RELAXED)] = (uint32_t)i;
}

/* Puts the points of each bin in order again: threads came as they came. */
static void order_chunk(void *context, int worker, size_t begin, size_t end)
{
    const point_bins *b = context;
    (void)worker;
    for (size_t k = begin; k < end; k++)
        for (uint32_t from = b->begin[k] + 1; from < b->begin[k + 1]; from++) {
            const uint32_t item = b->item[from];
            uint32_t to = from;
            for (; to > b->begin[k] && b->item[to - 1] > item; to--) b->item[to] = b->item[to - 1];
            b->item[to] = item;
        }
}

/* Points by their bins, which `bin` receives. */
static void fill(point_bins *b, size_t count, size_t total, threads *pool, uint32_t *bin)
{
    bins_job job = {b, bin};
    double shared = 0;
    uint32_t sum = 0;
    threads_run(pool, count, CHUNK, find_chunk, &job);
    for (size_t k = 0; k < total; k++) {
        const uint32_t here = b->begin[k + 1];
        shared += (double)here * here;
        b->begin[k + 1] = sum;
        sum += here;
    }
    b->dense = shared > MOST_SHARED * (double)count;
    if (b->dense) pool = NULL; /* to put those in order would take long */
    threads_run(pool, count, CHUNK, put_chunk, &job);
    if (threads_count(pool) > 1) threads_run(pool, total, CHUNK, order_chunk, b);
}

point_bins *point_bins_new(const vec3 *points, size_t count, threads *pool, error *e)
{
    assert(count > 0 && count < UINT32_MAX);
    const char *what = "the search for near points";
    point_bins *b = mem_alloc(sizeof *b);
    const bbox box = bbox_of_points(points, count, pool);
    const vec3 size = bbox_size(box);
    const double longest = bbox_longest(box);
    b->points = points;
    b->origin = box.min;
    b->edge = longest > 0 ? longest / AXIS_MOST : 1;
    const size_t wanted = BINS_PER_POINT * count + 8, most = wanted < UINT32_MAX ? wanted : UINT32_MAX;
    size_t total;
    while ((total = bins_of(size, b->edge, b->bins)) > most) b->edge *= WIDER;
    b->over = 1 / b->edge;
    b->begin = mem_array(total + 1, sizeof *b->begin, what, e);
    b->item = mem_array(count, sizeof *b->item, what, e);
    uint32_t *bin = mem_array(count, sizeof *bin, what, e);
    const bool ok = b->begin && b->item && bin;
    if (ok) fill(b, count, total, pool, bin);
    free(bin);
    if (ok && !threads_stopped(pool)) return b;
    if (ok) error_set(e, ERROR_CANCELLED, "stopped");
    point_bins_free(b);
    return NULL;
}

void point_bins_free(point_bins *b)
{
    if (!b) return;
    free(b->begin);
    free(b->item);
    free(b);
}

bool point_bins_are_dense(const point_bins *b)
{
    return b->dense;
}

typedef struct search {
    vec3 x;
    int32_t at[3]; /* its bin */
    double best2;
    uint32_t best;
} search;

/* The bins from `low` to `high` of a row, as far as there are any. */
static void look_along(const point_bins *b, size_t row, int32_t low, int32_t high, search *s)
{
    if (low < 0) low = 0;
    if (high > b->bins[0] - 1) high = b->bins[0] - 1;
    if (low > high) return;
    const uint32_t end = b->begin[row + (size_t)high + 1];
    for (uint32_t k = b->begin[row + (size_t)low]; k < end; k++) {
        const double d2 = vec3_norm2(vec3_sub(b->points[b->item[k]], s->x));
        if (d2 >= s->best2) continue;
        s->best2 = d2;
        s->best = b->item[k];
    }
}

/* The bins that are `ring` from the place's own along one axis at least, and along none more. */
static void look_at_ring(const point_bins *b, int32_t ring, search *s)
{
    for (int32_t z = s->at[2] - ring; z <= s->at[2] + ring; z++)
        for (int32_t y = s->at[1] - ring; z >= 0 && z < b->bins[2] && y <= s->at[1] + ring; y++) {
            if (y < 0 || y >= b->bins[1]) continue;
            const size_t row = row_of(b, y, z);
            if (abs(z - s->at[2]) == ring || abs(y - s->at[1]) == ring)
                look_along(b, row, s->at[0] - ring, s->at[0] + ring, s);
            else {
                look_along(b, row, s->at[0] - ring, s->at[0] - ring, s);
                look_along(b, row, s->at[0] + ring, s->at[0] + ring, s);
            }
        }
}

/* Lower bound on the distance of the points beyond a ring of bins; infinite if there are none. */
static double way_beyond(const point_bins *b, int32_t ring, const search *s)
{
    double way = INFINITY;
    for (int a = 0; a < 3; a++) {
        const double at = vec3_get(s->x, a) - vec3_get(b->origin, a);
        if (s->at[a] - ring > 0) way = fmin(way, at - (s->at[a] - ring) * b->edge);
        if (s->at[a] + ring < b->bins[a] - 1) way = fmin(way, (s->at[a] + ring + 1) * b->edge - at);
    }
    return way;
}

/* Tolerance, in edges of a bin: rounding may put a point into the bin next to its own. */
static const double ROUNDING = 1e-9;

/* A point no farther than `reach`, of the few bins that one may be in; false when there is none. */
static bool find_any(const point_bins *b, vec3 x, double reach, search *out)
{
    const double reach2 = reach * reach;
    const vec3 from = vec3_sub(x, (vec3){reach, reach, reach}), to = vec3_add(x, (vec3){reach, reach, reach});
    const int32_t low = bin_along(b, from, 0), high = bin_along(b, to, 0), last_y = bin_along(b, to, 1),
                  last_z = bin_along(b, to, 2);
    for (int32_t z = bin_along(b, from, 2); z <= last_z; z++)
        for (int32_t y = bin_along(b, from, 1); y <= last_y; y++) {
            const size_t row = row_of(b, y, z);
            const uint32_t end = b->begin[row + (size_t)high + 1];
            for (uint32_t k = b->begin[row + (size_t)low]; k < end; k++) {
                out->best = b->item[k];
                out->best2 = vec3_norm2(vec3_sub(b->points[out->best], x));
                if (out->best2 <= reach2) return true;
            }
        }
    return false;
}

uint32_t point_bins_nearest(const point_bins *b, vec3 x, double enough, double *distance)
{
    search s = {.x = x, .best2 = INFINITY};
    if (enough > 0 && enough < b->edge && find_any(b, x, enough, &s)) {
        *distance = sqrt(s.best2);
        return s.best;
    }
    s.best2 = INFINITY;
    const double enough2 = enough * fabs(enough);
    for (int a = 0; a < 3; a++) s.at[a] = bin_along(b, x, a);
    for (int32_t ring = 0;; ring++) {
        look_at_ring(b, ring, &s);
        if (s.best2 <= enough2) break;
        const double way = way_beyond(b, ring, &s) - ROUNDING * b->edge;
        if (!(way < INFINITY) || (way > 0 && s.best2 <= way * way)) break;
    }
    *distance = sqrt(s.best2);
    return s.best;
}

void point_bins_within(const point_bins *b, vec3 x, double reach, point_bins_visit visit, void *context)
{
    const double wide = reach + ROUNDING * b->edge, reach2 = reach * reach;
    const vec3 from = vec3_sub(x, (vec3){wide, wide, wide}), to = vec3_add(x, (vec3){wide, wide, wide});
    for (int32_t z = bin_along(b, from, 2); z <= bin_along(b, to, 2); z++)
        for (int32_t y = bin_along(b, from, 1); y <= bin_along(b, to, 1); y++) {
            const size_t row = row_of(b, y, z);
            const uint32_t end = b->begin[row + (size_t)bin_along(b, to, 0) + 1];
            for (uint32_t k = b->begin[row + (size_t)bin_along(b, from, 0)]; k < end; k++)
                if (vec3_norm2(vec3_sub(b->points[b->item[k]], x)) <= reach2) visit(context, b->item[k]);
        }
}
