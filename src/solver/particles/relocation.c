#include "solver/particles/relocation.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "geometry/near_points.h"
#include "packing/neighbours.h"

/* A point and how near its nearest is, or a place and how near its nearest point: over the spacing. */
typedef struct ranked {
    double distance, size;
    vec3 at;
    uint32_t index;
} ranked;

static int nearest_first(const void *a, const void *b)
{
    const ranked *x = a, *y = b;
    if (x->distance != y->distance) return x->distance < y->distance ? -1 : 1;
    return (x->index > y->index) - (x->index < y->index);
}

static int farthest_first(const void *a, const void *b)
{
    return nearest_first(b, a);
}

static double crowded_below(const relocation_input *in)
{
    return in->crowded > 0 ? in->crowded : RELOCATION_CROWDED;
}

/* Lists of who is within so many spacings, times the mean of the sizes. */
static neighbours *lists_of(const relocation_input *in, const vec3 *x, const double *size, size_t count,
                            double within, threads *pool, error *e)
{
    neighbours *n = neighbours_new(count, in->list_limit, e);
    if (n && neighbours_build(n, count, x, size, within * in->h, pool, e)) return n;
    neighbours_free(n);
    return NULL;
}

/* Leaves those of ranked entries that have no earlier one within so many spacings. */
static bool thin_out(const relocation_input *in, ranked *r, double within, threads *pool, size_t *count,
                     error *e)
{
    vec3 *x = mem_array(*count, sizeof *x, "the places of points", e);
    double *size = mem_array(*count, sizeof *size, "the places of points", e);
    bool *gone = mem_array(*count, sizeof *gone, "the places of points", e);
    bool ok = x && size && gone;
    for (size_t k = 0; ok && k < *count; k++) {
        x[k] = r[k].at;
        size[k] = r[k].size;
    }
    neighbours *near = ok ? lists_of(in, x, size, *count, within, pool, e) : NULL;
    size_t kept = 0;
    for (size_t k = 0; near && k < *count; k++) {
        for (uint32_t m = 0; m < near->list_count[k]; m++) {
            uint32_t j = neighbours_list(near, k)[m];
            gone[k] |= j < k && !gone[j];
        }
        if (!gone[k]) r[kept++] = r[k];
    }
    ok = near != NULL;
    if (ok) *count = kept;
    neighbours_free(near);
    free(x);
    free(size);
    free(gone);
    return ok;
}

/* The first `wanted` of those, without lists: each is held against these alone. */
static void thin_out_few(const relocation_input *in, ranked *r, double within, size_t wanted, size_t *count)
{
    size_t kept = 0;
    for (size_t k = 0; k < *count && kept < wanted; k++) {
        bool gone = false;
        for (size_t m = 0; m < kept && !gone; m++) {
            const double reach = 0.5 * within * in->h * (r[k].size + r[m].size);
            gone = vec3_norm2(vec3_sub(r[k].at, r[m].at)) < reach * reach;
        }
        if (!gone) r[kept++] = r[k];
    }
    *count = kept;
}

/* A point, and how near its nearest is. */
typedef struct crowd_job {
    const relocation_input *in;
    const near_points *near;
    double largest; /* size */
    double *least;  /* of each point */
} crowd_job;

typedef struct crowd_point {
    const relocation_input *in;
    uint32_t point;
    double least;
} crowd_point;

static void look_at_other(void *context, uint32_t j)
{
    crowd_point *own = context;
    const relocation_input *in = own->in;
    const uint32_t i = own->point;
    if (i == j) return;
    const double between = 0.5 * in->h * (in->size[i] + in->size[j]);
    own->least = fmin(own->least, vec3_norm(vec3_sub(in->point[i], in->point[j])) / between);
}

static void crowd_chunk(void *context, int worker, size_t begin, size_t end)
{
    const crowd_job *job = context;
    const relocation_input *in = job->in;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        crowd_point own = {in, (uint32_t)i, INFINITY};
        const double reach = 0.5 * crowded_below(in) * in->h * (in->size[i] + job->largest);
        near_points_within(job->near, in->point[i], reach, look_at_other, &own);
        job->least[i] = own.least;
    }
}

/* The points that crowd, the most crowded first; of two that are near each other one. */
static bool find_crowded(const relocation_input *in, const near_points *near, threads *pool, ranked **out,
                         size_t *found, error *e)
{
    ranked *r = *out = mem_array(in->count, sizeof *r, "the places of points", e);
    crowd_job job = {in, near, 0, mem_array(in->count, sizeof *job.least, "the places of points", e)};
    const bool ok = r && job.least;
    *found = 0;
    for (size_t i = 0; i < in->count; i++) job.largest = fmax(job.largest, in->size[i]);
    if (ok) threads_run(pool, in->count, 512, crowd_chunk, &job);
    for (size_t i = 0; ok && i < in->count; i++)
        if (job.least[i] < crowded_below(in) && !(in->held && in->held[i]))
            r[(*found)++] = (ranked){job.least[i], in->size[i], in->point[i], (uint32_t)i};
    free(job.least);
    if (!ok || *found == 0) return ok;
    qsort(r, *found, sizeof *r, nearest_first);
    return thin_out(in, r, crowded_below(in), pool, found, e);
}

typedef struct rank_job {
    const relocation_input *in;
    const near_points *near;
    double enough; /* whoever has a point so near is not bare, whatever the point's size */
    ranked *out;
} rank_job;

/* Whether point i, if there is such, is near enough to a place. */
static bool is_enough(const rank_job *job, size_t place, uint32_t i, double *distance)
{
    if (i >= job->in->count) return false;
    *distance = vec3_norm(vec3_sub(job->in->place[place], job->in->point[i]));
    return *distance <= job->enough;
}

static void rank_chunk(void *context, int worker, size_t begin, size_t end)
{
    const rank_job *job = context;
    const relocation_input *in = job->in;
    uint32_t before = in->near[begin];
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        double distance;
        uint32_t i = in->near[k];
        if (!is_enough(job, k, i, &distance)) {
            i = before; /* places that follow each other are near each other */
            if (!is_enough(job, k, i, &distance))
                i = near_points_nearest(job->near, in->place[k], job->enough, &distance);
        }
        in->near[k] = before = i;
        job->out[k] = (ranked){distance / (in->h * in->size[i]), in->size[i], in->place[k], (uint32_t)k};
    }
}

static double bare_from(const relocation_input *in)
{
    return in->bare > 0 ? in->bare : RELOCATION_BARE;
}

/* The places that are bare, the barest first; of two that are near each other one. Of few points each place has more others near it
 * than are wanted: then no more than these. */
static bool find_bare(const relocation_input *in, const near_points *near, size_t wanted, threads *pool,
                      ranked **out, size_t *found, error *e)
{
    ranked *r = *out = mem_array(in->places, sizeof *r, "the bare places", e);
    *found = 0;
    double least = INFINITY;
    for (size_t i = 0; i < in->count; i++) least = fmin(least, in->size[i]);
    rank_job job = {in, near, bare_from(in) * in->h * least, r};
    if (r) threads_run(pool, in->places, 256, rank_chunk, &job);
    for (size_t k = 0; r && k < in->places; k++)
        if (r[k].distance > bare_from(in)) r[(*found)++] = r[k];
    if (!r || *found == 0) return r != NULL;
    qsort(r, *found, sizeof *r, farthest_first);
    if (wanted < *found / in->count) {
        thin_out_few(in, r, RELOCATION_CROWDED, wanted, found);
        return true;
    }
    return thin_out(in, r, RELOCATION_CROWDED, pool, found, e);
}

bool relocation_choose(const relocation_input *in, threads *pool, relocation **out, size_t *moves, error *e)
{
    near_points *near = near_points_new(in->point, in->count, pool, e);
    ranked *crowded = NULL, *bare = NULL;
    relocation *chosen = NULL;
    size_t points = 0, places = 0, count = 0;
    bool ok = near && find_crowded(in, near, pool, &crowded, &points, e) &&
              find_bare(in, near, points, pool, &bare, &places, e) &&
              (chosen = mem_array(points + 1, sizeof *chosen, "the places of points", e));
    while (ok && count < points && count < places && bare[count].distance > crowded[count].distance) {
        chosen[count] = (relocation){crowded[count].index, bare[count].index};
        count++;
    }
    near_points_free(near);
    free(crowded);
    free(bare);
    if (ok) {
        *out = chosen;
        *moves = count;
    }
    return ok;
}
