// SPDX-License-Identifier: Apache-2.0
#include "sampling/voronoi/partitions.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/space/bbox.h"

/* Maximum number of own points of a partition, and maximum number of partitions. */
static const size_t PARTITION_POINTS = 200000, PARTITIONS_MOST = 16;
/* Bins of the histogram that determines the cuts. */
enum { BINS = 4096 };
/* Consecutive points of a span, which are mostly near each other. */
enum { SPAN = THREADS_GRAIN };
/* Width of the halo over the reach of the lists: a star uses the lists of the points that its listed
 * points list. */
static const double HALO_REACHES = 3;

static void note_spans(const partitions_input *in, partitions *out)
{
    for (size_t first = 0; first < in->count; first += SPAN) {
        double low = INFINITY, high = -INFINITY;
        for (size_t i = first; i < in->count && i < first + SPAN; i++) {
            const double at = vec3_get(in->position[i], out->axis);
            low = at < low ? at : low;
            high = at > high ? at : high;
        }
        out->span[first / SPAN] = (partitions_span){low, high};
    }
}

/* Upper bound of the number of points of a partition with its halo, from the histogram. */
static size_t most_points(const partitions_input *in, const partitions *all, const size_t bin[BINS],
                          double low, double width)
{
    size_t most = all->count > 1 && width > 0 ? 0 : in->count, before[BINS + 1] = {0};
    for (size_t b = 0; b < BINS; b++) before[b + 1] = before[b] + bin[b];
    for (size_t k = 0; most < in->count && k < all->count; k++) {
        const double from = k > 0 ? (all->end[k - 1] - all->halo - low) / width - 1 : 0,
                     to = (all->end[k] + all->halo - low) / width + 2;
        const size_t first = from > 0 ? (size_t)from : 0, last = to < BINS ? (size_t)to : BINS,
                     points = before[last] - before[first < last ? first : last];
        most = points > most ? points : most;
    }
    return most;
}

bool partitions_cut(const partitions_input *in, threads *pool, partitions *out, error *e)
{
    *out = (partitions){.count = in->count / PARTITION_POINTS < PARTITIONS_MOST
                                     ? in->count / PARTITION_POINTS + 1
                                     : PARTITIONS_MOST};
    out->end = mem_array(out->count, sizeof *out->end, "a set's parts", e);
    if (!out->end) return false;
    const bbox box = bbox_of_points(in->position, in->count, pool);
    double coarsest = 0;
    for (size_t i = 0; i < in->count; i++) coarsest = in->spacing[i] > coarsest ? in->spacing[i] : coarsest;
    vec3 size = vec3_sub(box.max, box.min);
    out->axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    out->halo = HALO_REACHES * in->cutoff * coarsest;
    out->span = mem_array(in->count / SPAN + 1, sizeof *out->span, "a set's parts", e);
    if (!out->span) return false;
    note_spans(in, out);
    double low = vec3_get(box.min, out->axis), width = vec3_get(size, out->axis) / BINS;
    size_t bin[BINS] = {0}, k = 0, seen = 0;
    for (size_t i = 0; out->count > 1 && width > 0 && i < in->count; i++) {
        double at = (vec3_get(in->position[i], out->axis) - low) / width;
        bin[at < BINS ? (size_t)at : BINS - 1]++;
    }
    for (size_t b = 0; b < BINS; b++) {
        seen += bin[b];
        while (k + 1 < out->count && seen * out->count >= (k + 1) * in->count)
            out->end[k++] = low + (double)(b + 1) * width;
    }
    while (k < out->count) out->end[k++] = INFINITY;
    out->most = most_points(in, out, bin, low, width);
    return true;
}

void partitions_free(partitions *s)
{
    free(s->end);
    free(s->span);
    *s = (partitions){0};
}

typedef struct gather_job {
    const partitions_input *in;
    const partitions *all;
    partition *s;
    double low, high;
    size_t *begin; /* per span: the number of its points in the partition or halo; later its first index */
} gather_job;

/* Whether no point of a span is in the partition or its halo. */
static bool passes_by(const gather_job *job, size_t span)
{
    return job->all->span[span].high < job->low || job->all->span[span].low >= job->high;
}

static bool is_near(const gather_job *job, size_t i)
{
    const double at = vec3_get(job->in->position[i], job->s->axis);
    return at >= job->low && at < job->high;
}

static size_t span_end(const gather_job *job, size_t span)
{
    return (span + 1) * SPAN < job->in->count ? (span + 1) * SPAN : job->in->count;
}

static void count_spans(void *context, int worker, size_t span, size_t end)
{
    const gather_job *job = context;
    (void)worker;
    for (; span < end; span++) {
        job->begin[span] = 0;
        for (size_t i = span * SPAN; !passes_by(job, span) && i < span_end(job, span); i++)
            job->begin[span] += is_near(job, i);
    }
}

static void copy_spans(void *context, int worker, size_t span, size_t end)
{
    const gather_job *job = context;
    const partitions_input *in = job->in;
    partition *s = job->s;
    (void)worker;
    for (; span < end; span++) {
        size_t found = job->begin[span];
        for (size_t i = span * SPAN; !passes_by(job, span) && i < span_end(job, span); i++) {
            if (!is_near(job, i)) continue;
            s->position[found] = in->position[i];
            s->normal[found] = in->normal[i];
            s->spacing[found] = in->spacing[i];
            s->index[found] = (uint32_t)i;
            if (s->label) s->label[found] = in->label[i];
            if (s->flags) s->flags[found] = in->flags[i];
            found++;
        }
    }
}

/* Copies the points of a partition and its halo, and sets its count. */
static bool gather_points(const partitions_input *in, const partitions *all, threads *pool, partition *s,
                          error *e)
{
    const size_t spans = (in->count + SPAN - 1) / SPAN;
    gather_job job = {in, all, s, s->low - all->halo, s->high + all->halo, NULL};
    job.begin = mem_array(spans, sizeof *job.begin, "a part of a set", e);
    if (!job.begin) return false;
    threads_run(pool, spans, 1, count_spans, &job);
    s->count = 0;
    for (size_t k = 0; k < spans; k++) {
        const size_t here = job.begin[k];
        job.begin[k] = s->count;
        s->count += here;
    }
    assert(s->count <= all->most);
    threads_run(pool, spans, 1, copy_spans, &job);
    free(job.begin);
    if (!threads_may_go_on(pool, e)) return false;
    return true;
}

/* Allocates the arrays for the largest partition. */
static bool reserve(const partitions_input *in, const partitions *all, partition *s, error *e)
{
    const char *what = "a part of a set";
    const size_t most = all->most;
    s->normal = mem_array(most, sizeof *s->normal, what, e);
    s->spacing = mem_array(most, sizeof *s->spacing, what, e);
    s->index = mem_array(most, sizeof *s->index, what, e);
    if (in->label) s->label = mem_array(most, sizeof *s->label, what, e);
    if (in->flags) s->flags = mem_array(most, sizeof *s->flags, what, e);
    s->near = neighbours_new(most, SIZE_MAX, e);
    s->position = mem_array(most, sizeof *s->position, what, e);
    return s->position && s->normal && s->spacing && s->index && s->near && (!in->label || s->label) &&
           (!in->flags || s->flags);
}

bool partition_fill(const partitions_input *in, const partitions *all, size_t k, threads *pool,
                    partition *out, error *e)
{
    assert(k < all->count);
    if (!out->position && !reserve(in, all, out, e)) return false;
    out->axis = all->axis;
    out->low = k > 0 ? all->end[k - 1] : -INFINITY;
    out->high = all->end[k];
    out->count = 0;
    /* the histogram's last bin may end two partitions: the second is empty */
    if (out->low < out->high && !gather_points(in, all, pool, out, e)) return false;
    if (out->count == 0) return true;
    out->near->label = out->label;
    return neighbours_build(out->near, out->count, out->position, out->spacing, in->cutoff, pool, e);
}

void partition_free(partition *s)
{
    free(s->position);
    free(s->normal);
    free(s->spacing);
    free(s->index);
    free(s->label);
    free(s->flags);
    neighbours_free(s->near);
    *s = (partition){0};
}
