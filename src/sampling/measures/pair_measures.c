// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/pair_measures.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "sampling/packing/energy.h"
#include "geometry/space/packing.h"
#include "sampling/voronoi/partitions.h"
#include "sampling/voronoi/resolution.h"
#include "sampling/voronoi/voronoi.h"

/* Points in a chunk of work; each chunk has its own partial sums. */
enum { CHUNK = 256 };
/* Pairs whose energies are summed at once. */
enum { BATCH = 8 * ENERGY_LANES };
/* Minimum distance in the energy, as a fraction of the support: the energy is not bounded at 0. */
static const double CLOSEST = 1e-6;

/* Sums of one chunk. */
typedef struct pair_sums {
    double energy, nearest; /* relative energies; the smallest relative distance */
    size_t close, coincident, thin;
} pair_sums;

typedef struct pair_job {
    const pair_measures_input *in;
    const partition *part;
    pair_sums *sums; /* per chunk */
    double *gap;     /* per point: distance of the opposite wall, in spacings */
} pair_job;

typedef struct energy_batch {
    size_t count;
    double u2[BATCH], weight[BATCH], energy;
} energy_batch;

static void sum_batch(energy_batch *b)
{
    while (b->count % ENERGY_LANES) {
        b->u2[b->count] = 0.5;
        b->weight[b->count++] = 0;
    }
    b->energy += energy_cotangent_sum(b->u2, b->weight, b->count);
    b->count = 0;
}

static void add_pair(energy_batch *b, double u2, double weight)
{
    if (!(u2 < 1)) return;
    if (b->count == BATCH) sum_batch(b);
    b->u2[b->count] = fmax(u2, CLOSEST * CLOSEST);
    b->weight[b->count++] = weight;
}

/* The distance of the opposite walls on which two points lie, in spacings. INFINITY: the pair does not
 * determine it. Near a sharp edge the faces that meet there do not count as walls. */
static double wall_gap(const pair_measures_input *in, uint32_t i, uint32_t j, double distance, double mean)
{
    const sites *s = in->sites;
    if (distance >= RESOLUTION_REACH * mean || (in->at_wedge[i] && in->at_wedge[j])) return INFINITY;
    const vec3 r = vec3_sub(s->position[j], s->position[i]);
    return fmin(fabs(vec3_dot(s->normal[s->side[i]], r)), fabs(vec3_dot(s->normal[s->side[j]], r))) / mean;
}

static void measure_point(const pair_job *job, uint32_t at, pair_sums *sums)
{
    const pair_measures_input *in = job->in;
    const sites *s = in->sites;
    const uint32_t i = job->part->index[at], *list = neighbours_list(job->part->near, at);
    const double h = s->spacing[i], support = packing_support(in->sized ? h : in->h);
    energy_batch b;
    double nearest = INFINITY, gap = INFINITY;
    b.count = 0;
    b.energy = 0;
    for (uint32_t k = 0; k < job->part->near->list_count[at]; k++) {
        const uint32_t j = job->part->index[list[k]];
        const double distance = vec3_norm(vec3_sub(s->position[i], s->position[j])),
                     mean = 0.5 * (h + s->spacing[j]), size = mean / h, facing = sites_facing_pair(s, i, j);
        if (!(facing > SITES_OPPOSITE)) {
            gap = fmin(gap, wall_gap(in, i, j, distance, mean));
        } else if (s->piece[i] == s->piece[j] && !(in->kept && in->kept[i] && in->kept[j])) {
            nearest = fmin(nearest, distance / mean);
        }
        if (facing <= VORONOI_OPPOSITE_COSINE || s->piece[i] != s->piece[j]) continue;
        const double u = distance / (support * (in->sized ? size : 1));
        add_pair(&b, u * u, in->sized ? size * size : 1);
    }
    sum_batch(&b);
    sums->energy += b.energy / (energy_cotangent.ideal * in->ideal[i] / 6);
    sums->nearest = fmin(sums->nearest, nearest);
    sums->close += nearest < MEASURES_CLOSE;
    sums->coincident += nearest < MEASURES_COINCIDENT;
    sums->thin += gap < RESOLUTION_GAP;
    job->gap[i] = gap;
}

static void pair_chunk(void *context, int worker, size_t begin, size_t end)
{
    const pair_job *job = context;
    (void)worker;
    pair_sums sums = {.nearest = INFINITY};
    for (size_t k = begin; k < end; k++)
        if (partition_owns(job->part, k)) measure_point(job, (uint32_t)k, &sums);
    job->sums[begin / CHUNK] = sums;
}

static void add_sums(pair_sums *to, const pair_sums *s)
{
    to->energy += s->energy;
    to->nearest = fmin(to->nearest, s->nearest);
    to->close += s->close;
    to->coincident += s->coincident;
    to->thin += s->thin;
}

static int compare_numbers(const void *a, const void *b)
{
    const double p = *(const double *)a, q = *(const double *)b;
    return (p > q) - (p < q);
}

/* Computes measures.thin_factor. Sorts the gaps. */
static double thin_factor(double *gap, size_t count)
{
    const size_t allowed = (size_t)(MEASURES_THIN_SHARE * (double)count);
    qsort(gap, count, sizeof *gap, compare_numbers);
    return fmin(gap[allowed] / RESOLUTION_GAP, 1);
}

/* Reach of the neighbour lists, in spacings: the support, or the largest distance of opposite walls. */
static double reach_of(const pair_measures_input *in)
{
    double finest = INFINITY;
    for (size_t i = 0; i < in->sites->count; i++) finest = fmin(finest, in->sites->spacing[i]);
    return fmax(VORONOI_REACH, in->sized ? 0 : packing_support(in->h) / finest);
}

bool pair_measures_take(const pair_measures_input *in, threads *pool, measures *out, error *e)
{
    const sites *s = in->sites;
    const char *what = "the measures of pairs of points";
    const partitions_input cut = {s->count, s->position, s->position, s->spacing, NULL, NULL, reach_of(in)};
    partitions all;
    partition part = {0};
    pair_sums whole = {.nearest = INFINITY}, *sums = NULL;
    double *gap = mem_array(s->count, sizeof *gap, what, e);
    bool ok = partitions_cut(&cut, pool, &all, e) && gap &&
              (sums = mem_array(all.most / CHUNK + 1, sizeof *sums, what, e)) != NULL;
    for (size_t k = 0; ok && k < all.count; k++) {
        ok = partition_fill(&cut, &all, k, pool, &part, e);
        if (ok) threads_run(pool, part.count, CHUNK, pair_chunk, &(pair_job){in, &part, sums, gap});
        for (size_t c = 0; ok && c < (part.count + CHUNK - 1) / CHUNK; c++) add_sums(&whole, &sums[c]);
    }
    partition_free(&part);
    partitions_free(&all);
    free(sums);
    out->thin_factor = ok && !threads_stopped(pool) ? thin_factor(gap, s->count) : 1;
    free(gap);
    if (!ok) return false;
    const double n = (double)s->count;
    out->energy_excess = whole.energy / n - 1;
    out->min_spacing_ratio = isfinite(whole.nearest) ? whole.nearest : NAN;
    out->close_share = (double)whole.close / n;
    out->coincident = whole.coincident;
    out->thin_count = whole.thin;
    return true;
}
