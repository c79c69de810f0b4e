#include "packing/relocation.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "packing/point_tree.h"
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

/* Lists of who is within RELOCATION_CROWDED spacings, times the mean of the sizes. */
static neighbours *lists_of(const relocation_input *in, const vec3 *x, const double *size, size_t count,
                            threads *pool, error *e)
{
    neighbours *n = neighbours_new(count, in->list_limit, e);
    if (n && neighbours_build(n, count, x, size, RELOCATION_CROWDED * in->h, pool, e)) return n;
    neighbours_free(n);
    return NULL;
}

/* Leaves those of ranked entries that have no earlier one as near as points that crowd. */
static bool thin_out(const relocation_input *in, ranked *r, threads *pool, size_t *count, error *e)
{
    vec3 *x = mem_array(*count, sizeof *x, "the places of points", e);
    double *size = mem_array(*count, sizeof *size, "the places of points", e);
    bool *gone = mem_array(*count, sizeof *gone, "the places of points", e);
    bool ok = x && size && gone;
    for (size_t k = 0; ok && k < *count; k++) {
        x[k] = r[k].at;
        size[k] = r[k].size;
    }
    neighbours *near = ok ? lists_of(in, x, size, *count, pool, e) : NULL;
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

/* The points that crowd, the most crowded first; of two that are near each other one. */
static bool find_crowded(const relocation_input *in, threads *pool, ranked **out, size_t *found, error *e)
{
    neighbours *near = lists_of(in, in->point, in->size, in->count, pool, e);
    ranked *r = near ? mem_array(in->count, sizeof *r, "the places of points", e) : NULL;
    *out = r;
    *found = 0;
    for (size_t i = 0; r && i < in->count; i++) {
        double least = INFINITY;
        if (in->held && in->held[i]) continue;
        for (uint32_t k = 0; k < near->list_count[i]; k++) {
            uint32_t j = neighbours_list(near, i)[k];
            double between = 0.5 * in->h * (in->size[i] + in->size[j]);
            least = fmin(least, vec3_norm(vec3_sub(in->point[i], in->point[j])) / between);
        }
        if (least < RELOCATION_CROWDED)
            r[(*found)++] = (ranked){least, in->size[i], in->point[i], (uint32_t)i};
    }
    neighbours_free(near);
    if (!r || *found == 0) return r != NULL;
    qsort(r, *found, sizeof *r, nearest_first);
    return thin_out(in, r, pool, found, e);
}

typedef struct rank_job {
    const relocation_input *in;
    const point_tree *tree;
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
                i = point_tree_nearest(job->tree, in->place[k], job->enough, &distance);
        }
        in->near[k] = before = i;
        job->out[k] = (ranked){distance / (in->h * in->size[i]), in->size[i], in->place[k], (uint32_t)k};
    }
}

static double bare_from(const relocation_input *in)
{
    return in->bare > 0 ? in->bare : RELOCATION_BARE;
}

/* The places that are bare, the barest first; of two that are near each other one. */
static bool find_bare(const relocation_input *in, threads *pool, ranked **out, size_t *found, error *e)
{
    point_tree *tree = point_tree_new(in->point, in->count, e);
    ranked *r = tree ? mem_array(in->places, sizeof *r, "the bare places", e) : NULL;
    *out = r;
    *found = 0;
    double least = INFINITY;
    for (size_t i = 0; i < in->count; i++) least = fmin(least, in->size[i]);
    rank_job job = {in, tree, bare_from(in) * in->h * least, r};
    if (r) threads_run(pool, in->places, 256, rank_chunk, &job);
    for (size_t k = 0; r && k < in->places; k++)
        if (r[k].distance > bare_from(in)) r[(*found)++] = r[k];
    point_tree_free(tree);
    if (!r || *found == 0) return r != NULL;
    qsort(r, *found, sizeof *r, farthest_first);
    return thin_out(in, r, pool, found, e);
}

bool relocation_choose(const relocation_input *in, threads *pool, relocation **out, size_t *moves, error *e)
{
    ranked *crowded = NULL, *bare = NULL;
    relocation *chosen = NULL;
    size_t points = 0, places = 0, count = 0;
    bool ok = find_crowded(in, pool, &crowded, &points, e) && find_bare(in, pool, &bare, &places, e) &&
              (chosen = mem_array(points + 1, sizeof *chosen, "the places of points", e));
    while (ok && count < points && count < places && bare[count].distance > crowded[count].distance) {
        chosen[count] = (relocation){crowded[count].index, bare[count].index};
        count++;
    }
    free(crowded);
    free(bare);
    if (ok) {
        *out = chosen;
        *moves = count;
    }
    return ok;
}
