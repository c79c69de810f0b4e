// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/particles/relocation.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/space/cell_list.h"

/* The object that messages about memory name. */
static const char *const WHAT = "the relocation of points";

/* A point or a place with the distance of its nearest (other) point, in spacings. */
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

static double dense_limit(const relocation_input *in)
{
    return in->dense > 0 ? in->dense : RELOCATION_DENSE;
}

/* Removes the entries near one that is kept. */
typedef struct thinning_job {
    const ranked *entry;
    bool *removed;
    double within; /* world units, for entries of size 1 */
    uint32_t kept;
} thinning_job;

static void visit_entry(void *context, uint32_t j)
{
    thinning_job *t = context;
    const ranked *entry = &t->entry[t->kept], *other = &t->entry[j];
    const double reach = 0.5 * t->within * (entry->size + other->size);
    t->removed[j] |= j > t->kept && vec3_norm2(vec3_sub(entry->at, other->at)) < reach * reach;
}

/* Keeps the first `wanted` of the ranked entries without an earlier kept entry within `within` spacings. */
static bool thin_out(const relocation_input *in, ranked *r, double within, size_t wanted, threads *pool,
                     size_t *count, error *e)
{
    vec3 *x = mem_array(*count, sizeof *x, WHAT, e);
    bool *removed = mem_array(*count, sizeof *removed, WHAT, e);
    uint32_t *kept = mem_array(*count, sizeof *kept, WHAT, e);
    double largest = 0;
    for (size_t k = 0; x && k < *count; k++) {
        x[k] = r[k].at;
        largest = fmax(largest, r[k].size);
    }
    cell_list *near = x && removed && kept ? cell_list_new(x, *count, pool, e) : NULL;
    size_t kept_count = 0;
    for (uint32_t k = 0; near && k < *count && kept_count < wanted; k++) {
        if (removed[k]) continue;
        thinning_job t = {r, removed, within * in->h, k};
        cell_list_within(near, x[k], 0.5 * t.within * (r[k].size + largest), visit_entry, &t);
        kept[kept_count++] = k;
    }
    for (size_t k = 0; k < kept_count; k++) r[k] = r[kept[k]];
    const bool ok = near != NULL;
    if (ok) *count = kept_count;
    cell_list_free(near);
    free(x);
    free(removed);
    free(kept);
    return ok;
}

/* Computes the distance of the nearest other point of each point. */
typedef struct density_job {
    const relocation_input *in;
    const cell_list *near;
    double largest; /* the largest size */
    double *least;  /* per point, in spacings */
} density_job;

typedef struct density_visit {
    const relocation_input *in;
    uint32_t point;
    double least;
} density_visit;

static void visit_neighbour(void *context, uint32_t j)
{
    density_visit *v = context;
    const relocation_input *in = v->in;
    const uint32_t i = v->point;
    if (i == j) return;
    const double between = 0.5 * in->h * (in->size[i] + in->size[j]);
    v->least = fmin(v->least, vec3_norm(vec3_sub(in->point[i], in->point[j])) / between);
}

static void density_chunk(void *context, int worker, size_t begin, size_t end)
{
    const density_job *job = context;
    const relocation_input *in = job->in;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        density_visit v = {in, (uint32_t)i, INFINITY};
        const double reach = 0.5 * dense_limit(in) * in->h * (in->size[i] + job->largest);
        cell_list_within(job->near, in->point[i], reach, visit_neighbour, &v);
        job->least[i] = v.least;
    }
}

static bool is_dense(const density_job *job, size_t i)
{
    const relocation_input *in = job->in;
    return job->least[i] < dense_limit(in) && !(in->immovable && in->immovable[i]);
}

/* The over-dense points, densest first. Only the first of several points near each other is kept. */
static bool find_dense(const relocation_input *in, const cell_list *near, threads *pool, ranked **out,
                       size_t *found, error *e)
{
    density_job job = {in, near, 0, mem_array(in->count, sizeof *job.least, WHAT, e)};
    size_t all = 0;
    *found = 0;
    for (size_t i = 0; i < in->count; i++) job.largest = fmax(job.largest, in->size[i]);
    if (job.least) threads_run(pool, in->count, THREADS_GRAIN, density_chunk, &job);
    for (size_t i = 0; job.least && i < in->count; i++) all += is_dense(&job, i);
    ranked *r = *out = job.least ? mem_array(all, sizeof *r, WHAT, e) : NULL;
    for (size_t i = 0; r && i < in->count; i++)
        if (is_dense(&job, i)) r[(*found)++] = (ranked){job.least[i], in->size[i], in->point[i], (uint32_t)i};
    free(job.least);
    if (!r || *found == 0) return r != NULL;
    qsort(r, *found, sizeof *r, nearest_first);
    return thin_out(in, r, dense_limit(in), *found, pool, found, e);
}

typedef struct gap_job {
    const relocation_input *in;
    const cell_list *near;
    double reach;     /* a place with a point within this distance is not a gap for any size; world units */
    double *distance; /* per place: of its nearest point, in spacings of that point */
} gap_job;

/* Whether point i exists and is within `reach` of a place. */
static bool is_within_reach(const gap_job *job, size_t place, uint32_t i, double *distance)
{
    if (i >= job->in->count) return false;
    *distance = vec3_norm(vec3_sub(job->in->place[place], job->in->point[i]));
    return *distance <= job->reach;
}

static void gap_chunk(void *context, int worker, size_t begin, size_t end)
{
    const gap_job *job = context;
    const relocation_input *in = job->in;
    uint32_t before = in->near[begin];
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        double distance;
        uint32_t i = in->near[k];
        if (!is_within_reach(job, k, i, &distance)) {
            i = before; /* consecutive places are often near each other */
            if (!is_within_reach(job, k, i, &distance))
                i = cell_list_nearest(job->near, in->place[k], job->reach, &distance);
        }
        in->near[k] = before = i;
        job->distance[k] = distance / (in->h * in->size[i]);
    }
}

static double gap_limit(const relocation_input *in)
{
    return in->gap > 0 ? in->gap : RELOCATION_GAP;
}

/* The first `wanted` gaps, largest first. Only the first of several gaps near each other is kept. */
static bool find_gaps(const relocation_input *in, const cell_list *near, size_t wanted, threads *pool,
                      ranked **out, size_t *found, error *e)
{
    const double limit = gap_limit(in);
    double least = INFINITY, *distance = mem_array(in->places, sizeof *distance, WHAT, e);
    size_t all = 0;
    for (size_t i = 0; i < in->count; i++) least = fmin(least, in->size[i]);
    gap_job job = {in, near, limit * in->h * least, distance};
    if (distance) threads_run(pool, in->places, THREADS_GRAIN, gap_chunk, &job);
    for (size_t k = 0; distance && k < in->places; k++) all += distance[k] > limit;
    ranked *r = *out = distance ? mem_array(all, sizeof *r, WHAT, e) : NULL;
    *found = 0;
    for (size_t k = 0; r && k < in->places; k++)
        if (distance[k] > limit)
            r[(*found)++] = (ranked){distance[k], in->size[in->near[k]], in->place[k], (uint32_t)k};
    free(distance);
    if (!r || *found == 0) return r != NULL;
    qsort(r, *found, sizeof *r, farthest_first);
    return thin_out(in, r, RELOCATION_DENSE, wanted, pool, found, e);
}

bool relocation_choose(const relocation_input *in, threads *pool, relocation **out, size_t *moves, error *e)
{
    cell_list *near = cell_list_new(in->point, in->count, pool, e);
    ranked *dense = NULL, *gaps = NULL;
    relocation *chosen = NULL;
    size_t points = 0, places = 0, count = 0;
    bool ok = near && find_dense(in, near, pool, &dense, &points, e) &&
              (points == 0 || find_gaps(in, near, points, pool, &gaps, &places, e)) &&
              (chosen = mem_array(points + 1, sizeof *chosen, WHAT, e));
    while (ok && count < points && count < places && gaps[count].distance > dense[count].distance) {
        chosen[count] = (relocation){dense[count].index, gaps[count].index};
        count++;
    }
    cell_list_free(near);
    free(dense);
    free(gaps);
    if (ok) {
        *out = chosen;
        *moves = count;
    }
    return ok;
}
