// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/pair_measures.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "sampling/packing/energy.h"
#include "sampling/packing/point_flags.h"
#include "geometry/space/packing.h"
#include "sampling/voronoi/partitions.h"
#include "sampling/voronoi/resolution.h"
#include "sampling/voronoi/voronoi.h"

static const char what[] = "the measures of pairs of points";

/* Points in a chunk of work; each chunk has its own partial sums. */
enum { CHUNK = 256 };
/* Pairs whose energies are summed at once. */
enum { BATCH = 8 * ENERGY_LANES };
/* Minimum distance in the energy, as a fraction of the support: the energy is not bounded at 0. */
static const double CLOSEST = 1e-6;

/* Sums of one chunk. */
typedef struct pair_sums {
    double nearest; /* the smallest relative distance */
    double energy;  /* of the plain points */
    size_t close, coincident, thin;
} pair_sums;

typedef struct pair_job {
    const pair_measures_input *in;
    const partition *part;
    planar_cell *cells; /* or NULL */
    double *area;       /* of each point: of its cell, if that is certain */
    pair_sums *sums;    /* of each chunk; NULL: only cells are computed */
    float *lack; /* of each point: RESOLUTION_GAP minus its distance from the opposite wall in spacings; at
                         * least 0 */
    double *odd_energy; /* see pair_energies */
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

/* A pair of points, from the partition's copies. */
typedef struct pair {
    double square, facing; /* `square`: of the distance */
} pair;

/* The distance of the opposite walls on which two points lie, in spacings. INFINITY: the pair does not
 * determine it. Near a sharp edge the faces that meet there do not count as walls, unless they are parallel. */
static double wall_gap(const pair_measures_input *in, uint32_t i, uint32_t j, pair p, double mean)
{
    const sites *s = in->sites;
    const bool at_wedge =
        in->odd && in->odd[i] & in->odd[j] & PACKING_AT_WEDGE && p.facing > RESOLUTION_PARALLEL;
    if (p.square >= RESOLUTION_REACH * RESOLUTION_REACH * mean * mean || at_wedge) return INFINITY;
    const vec3 r = vec3_sub(s->position[j], s->position[i]);
    return fmin(fabs(vec3_dot(s->normal[sites_first(s, i)], r)),
                fabs(vec3_dot(s->normal[sites_first(s, j)], r))) /
           mean;
}

static pair pair_at(const pair_job *job, uint32_t at, uint32_t other)
{
    const partition *p = job->part;
    const sites *s = job->in->sites;
    const bool plain = !s->patch_labels && (!p->flags || !(p->flags[at] | p->flags[other]));
    return (pair){vec3_norm2(vec3_sub(p->position[at], p->position[other])),
                  plain ? vec3_dot(p->normal[at], p->normal[other])
                        : sites_facing_pair(s, p->index[at], p->index[other])};
}

static void measure_point(const pair_job *job, uint32_t at, pair_sums *sums)
{
    const pair_measures_input *in = job->in;
    const sites *s = in->sites;
    const partition *part = job->part;
    const uint32_t i = part->index[at], *list = neighbours_list(part->near, at);
    const double h = part->spacing[at], support = packing_support(in->sized ? h : in->h),
                 per_support2 = 1 / (support * support), per_h = 1 / h;
    energy_batch b;
    double nearest2 = INFINITY, gap = INFINITY;
    b.count = 0;
    b.energy = 0;
    for (uint32_t k = 0; k < part->near->list_count[at]; k++) {
        const uint32_t j = part->index[list[k]];
        const pair p = pair_at(job, at, list[k]);
        const double mean = 0.5 * (h + part->spacing[list[k]]), size = mean * per_h;
        const bool together = sites_piece(s, i) == sites_piece(s, j);
        if (!(p.facing > SITES_OPPOSITE)) {
            gap = fmin(gap, wall_gap(in, i, j, p, mean));
        } else if (together && !(in->kept && in->kept[i] && in->kept[j])) {
            if (p.square < nearest2 * mean * mean) nearest2 = p.square / (mean * mean);
        }
        if (p.facing <= VORONOI_OPPOSITE_COSINE || !together) continue;
        const double u2 = p.square * per_support2;
        if (in->sized)
            add_pair(&b, u2 / (size * size), size * size);
        else
            add_pair(&b, u2, 1);
    }
    sum_batch(&b);
    const double nearest = sqrt(nearest2);
    sums->nearest = fmin(sums->nearest, nearest);
    sums->close += nearest < MEASURES_CLOSE;
    sums->coincident += nearest < MEASURES_COINCIDENT;
    const double energy = b.energy / energy_cotangent.ideal;
    if (in->odd && in->odd[i])
        job->odd_energy[i] = energy;
    else
        sums->energy += energy;
    if (!(gap < RESOLUTION_GAP)) return;
    sums->thin++;
    job->lack[i] = (float)(RESOLUTION_GAP - gap);
}

static void pair_chunk(void *context, int worker, size_t begin, size_t end)
{
    const pair_job *job = context;
    const uint32_t *index = job->part->index;
    (void)worker;
    pair_sums sums = {.nearest = INFINITY};
    for (size_t k = begin; k < end; k++) {
        if (!partition_owns(job->part, k)) continue;
        if (job->cells)
            planar_cell_at(job->part, job->in->sites->piece, (uint32_t)k, &job->cells[index[k]],
                           &job->area[index[k]]);
        if (job->sums) measure_point(job, (uint32_t)k, &sums);
    }
    if (job->sums) job->sums[begin / CHUNK] = sums;
}

static void add_sums(pair_sums *to, const pair_sums *s)
{
    to->nearest = fmin(to->nearest, s->nearest);
    to->energy += s->energy;
    to->close += s->close;
    to->coincident += s->coincident;
    to->thin += s->thin;
}

static int compare_numbers(const void *a, const void *b)
{
    const float p = *(const float *)a, q = *(const float *)b;
    return (p < q) - (p > q);
}

/* See measures.thin_factor; sorts the values from the largest if more than the allowed ones are not 0. */
static double thin_factor(float *lack, size_t count, size_t thin)
{
    const size_t allowed = (size_t)(MEASURES_THIN_SHARE * (double)count);
    if (thin <= allowed) return 1;
    qsort(lack, count, sizeof *lack, compare_numbers);
    return 1 - lack[allowed] / RESOLUTION_GAP;
}

/* Reach of the neighbour lists, in spacings: the support, or the largest distance of opposite walls. */
static double reach_of(const pair_measures_input *in)
{
    double finest = INFINITY;
    for (size_t i = 0; i < in->sites->count; i++) finest = fmin(finest, in->sites->spacing[i]);
    return fmax(VORONOI_REACH, in->sized ? 0 : packing_support(in->h) / finest);
}

static void conclude(const pair_sums *whole, float *lack, size_t count, pair_energies *energy, measures *out)
{
    const double n = (double)count;
    energy->plain = whole->energy;
    out->thin_factor = thin_factor(lack, count, whole->thin);
    out->min_spacing_ratio = isfinite(whole->nearest) ? whole->nearest : NAN;
    out->close_share = (double)whole->close / n;
    out->coincident = whole->coincident;
    out->thin_count = whole->thin;
}

/* The points in partitions, with neighbour lists. */
typedef struct lists {
    partitions_input cut;
    partitions all;
    partition part;
    vec3 *normal; /* the first one of each point, if points have several */
} lists;

/* Close *out also after failure. */
static bool open_lists(const pair_measures_input *in, threads *pool, lists *out, error *e)
{
    const sites *s = in->sites;
    *out = (lists){.cut = {s->count, s->position, s->normal, s->spacing, NULL, in->odd, reach_of(in)}};
    if (s->side && s->side[s->count] != s->count) {
        out->normal = mem_array(s->count, sizeof *out->normal, what, e);
        if (!out->normal) return false;
        for (size_t i = 0; i < s->count; i++) out->normal[i] = s->normal[s->side[i]];
        out->cut.normal = out->normal;
    }
    return partitions_cut(&out->cut, pool, &out->all, e);
}

static void close_lists(lists *l)
{
    partition_free(&l->part);
    partitions_free(&l->all);
    free(l->normal);
}

bool pair_measures_take(const pair_measures_input *in, threads *pool, planar_cell *cells, double *area,
                        pair_energies *energy, measures *out, error *e)
{
    lists l;
    pair_sums whole = {.nearest = INFINITY};
    bool ok = open_lists(in, pool, &l, e);
    pair_job job = {.in = in, .part = &l.part, .cells = cells, .area = area, .odd_energy = energy->odd};
    if (ok && out) {
        job.lack = mem_array(in->sites->count, sizeof *job.lack, what, e);
        job.sums = mem_array(l.all.most / CHUNK + 1, sizeof *job.sums, what, e);
        ok = job.lack && job.sums;
    }
    for (size_t k = 0; ok && k < l.all.count; k++) {
        ok = partition_fill(&l.cut, &l.all, k, pool, &l.part, e);
        if (ok) threads_run(pool, l.part.count, CHUNK, pair_chunk, &job);
        for (size_t c = 0; ok && out && c < (l.part.count + CHUNK - 1) / CHUNK; c++)
            add_sums(&whole, &job.sums[c]);
    }
    ok = ok && (!threads_stopped(pool) || error_set(e, ERROR_CANCELLED, "stopped"));
    if (ok && out) conclude(&whole, job.lack, in->sites->count, energy, out);
    free(job.lack);
    free(job.sums);
    close_lists(&l);
    return ok;
}

typedef struct mean_job {
    const partition *part;
    const planar_cell *cells;
    const double *value;
    double *mean;
} mean_job;

static void mean_chunk(void *context, int worker, size_t begin, size_t end)
{
    const mean_job *job = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        const uint32_t i = job->part->index[k];
        if (partition_owns(job->part, k) && job->cells[i].certain)
            job->mean[i] = planar_cell_mean(job->part, (uint32_t)k, job->value);
    }
}

bool pair_measures_means(const pair_measures_input *in, const planar_cell *cells, const double *value,
                         threads *pool, double *mean, error *e)
{
    lists l;
    bool ok = open_lists(in, pool, &l, e);
    for (size_t k = 0; ok && k < l.all.count; k++) {
        ok = partition_fill(&l.cut, &l.all, k, pool, &l.part, e);
        if (ok) threads_run(pool, l.part.count, CHUNK, mean_chunk, &(mean_job){&l.part, cells, value, mean});
    }
    close_lists(&l);
    return ok && (!threads_stopped(pool) || error_set(e, ERROR_CANCELLED, "stopped"));
}
