// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/pair_measures.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/compare.h"
#include "base/core/isa.h"
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
enum { BATCH = 8 * ENERGY_LANES, LANES = ENERGY_LANES };
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

/* A pair beyond the support adds nothing. */
static void add_pair(energy_batch *b, double u2, double weight)
{
    if (b->count == BATCH) sum_batch(b);
    b->u2[b->count] = compare_larger(u2, CLOSEST * CLOSEST);
    b->weight[b->count] = weight;
    b->count += u2 < 1; /* unpredictable: no branch */
}

/* The distance of the opposite walls on which two points lie, in spacings. INFINITY: the pair does not
 * determine it. Near a sharp edge the faces that meet there do not count as walls, unless they are parallel. */
static double wall_gap(const pair_measures_input *in, uint32_t i, uint32_t j, double square, double facing,
                       double mean)
{
    const sites *s = in->sites;
    const bool at_wedge =
        in->odd && in->odd[i] & in->odd[j] & PACKING_AT_WEDGE && facing > RESOLUTION_PARALLEL;
    if (square >= RESOLUTION_REACH * RESOLUTION_REACH * mean * mean || at_wedge) return INFINITY;
    const vec3 r = vec3_sub(s->position[j], s->position[i]);
    return fmin(fabs(vec3_dot(s->normal[sites_first(s, i)], r)),
                fabs(vec3_dot(s->normal[sites_first(s, j)], r))) /
           mean;
}

/* Pairs of a point and the entries of its list. */
typedef struct listed_pairs {
    double relative2[VORONOI_STAR_MAX]; /* the square of the distance over the mean spacing */
    double u2[VORONOI_STAR_MAX], weight[VORONOI_STAR_MAX]; /* see energy_batch */
} listed_pairs;

ISA_CLONES static void compute_pairs(const voronoi_listed *restrict l, double h, double support, bool sized,
                                     listed_pairs *restrict out)
{
    const double per_h = 1 / h, per_support2 = 1 / (support * support);
    for (size_t first = 0; first < l->count; first += LANES)
        for (size_t lane = 0; lane < LANES; lane++) {
            const size_t k = first + lane;
            const double mean = 0.5 * (h + l->spacing[k]);
            out->relative2[k] = l->square[k] / (mean * mean);
            out->weight[k] = 1;
            out->u2[k] = l->square[k] * per_support2;
        }
    for (size_t first = 0; sized && first < l->count; first += LANES)
        for (size_t lane = 0; lane < LANES; lane++) {
            const size_t k = first + lane;
            const double size = 0.5 * (h + l->spacing[k]) * per_h;
            out->weight[k] = size * size;
            out->u2[k] /= out->weight[k];
        }
}

/* Replaces the cosines of pairs with several normals, or with normals without a sign. */
static void replace_cosines(const pair_job *job, uint32_t at, voronoi_listed *l)
{
    const partition *p = job->part;
    const sites *s = job->in->sites;
    const uint32_t *list = neighbours_list(p->near, at) + l->first;
    if (!s->patch_labels && !p->flags) return;
    for (uint32_t k = 0; k < l->count; k++)
        if (s->patch_labels || p->flags[at] | p->flags[list[k]])
            l->facing[k] = sites_facing_pair(s, p->index[at], p->index[list[k]]);
}

/* Sums over the pairs of one point. */
typedef struct point_sums {
    energy_batch energy;
    double nearest2, gap;
} point_sums;

static void add_pairs(const pair_job *job, uint32_t at, const voronoi_listed *l, point_sums *sums)
{
    const pair_measures_input *in = job->in;
    const sites *s = in->sites;
    const partition *part = job->part;
    const uint32_t i = part->index[at], *list = neighbours_list(part->near, at) + l->first;
    const double h = part->spacing[at];
    energy_batch *b = &sums->energy;
    listed_pairs of;
    compute_pairs(l, h, packing_support(in->sized ? h : in->h), in->sized, &of);
    for (uint32_t k = 0; k < l->count; k++) {
        const uint32_t j = part->index[list[k]];
        const double facing = l->facing[k];
        const bool together = sites_piece(s, i) == sites_piece(s, j);
        if (!(facing > SITES_OPPOSITE))
            sums->gap = fmin(sums->gap, wall_gap(in, i, j, l->square[k], facing, 0.5 * (h + l->spacing[k])));
        else if (together && !(in->kept && in->kept[i] && in->kept[j]))
            sums->nearest2 = compare_smaller(sums->nearest2, of.relative2[k]);
        if (facing > VORONOI_OPPOSITE_COSINE && together) add_pair(b, of.u2[k], of.weight[k]);
    }
}

static void add_nearest(double nearest, pair_sums *sums)
{
    sums->nearest = compare_smaller(sums->nearest, nearest);
    sums->close += nearest < MEASURES_CLOSE;
    sums->coincident += nearest < MEASURES_COINCIDENT;
}

static void measure_point(const pair_job *job, uint32_t at, pair_sums *sums)
{
    const pair_measures_input *in = job->in;
    const uint32_t i = job->part->index[at];
    point_sums of;
    of.energy.count = 0;
    of.energy.energy = 0;
    of.nearest2 = of.gap = INFINITY;
    for (uint32_t done = 0; done < job->part->near->list_count[at];) {
        voronoi_listed l;
        planar_cells_gather(job->part, at, done, &l);
        replace_cosines(job, at, &l);
        add_pairs(job, at, &l, &of);
        done += l.count;
    }
    sum_batch(&of.energy);
    add_nearest(sqrt(of.nearest2), sums);
    const double energy = of.energy.energy / energy_cotangent.ideal;
    if (in->odd && in->odd[i])
        job->odd_energy[i] = energy;
    else
        sums->energy += energy;
    if (!(of.gap < RESOLUTION_GAP)) return;
    sums->thin++;
    job->lack[i] = (float)(RESOLUTION_GAP - of.gap);
}

/* Measures points; `at`: in the partition. */
static void measure_points(const pair_job *job, const uint32_t *at, size_t count, pair_sums *sums)
{
    const pair_measures_input *in = job->in;
    const planar_points points = {job->part, in->sites->piece, in->sized ? 0 : packing_support(in->h),
                                  in->borders};
    planar_cell cell[PLANAR_CELLS_ONCE];
    double area[PLANAR_CELLS_ONCE];
    planar_pairs pairs[PLANAR_CELLS_ONCE];
    planar_cells_at(&points, at, count, job->cells ? cell : NULL, area, pairs);
    for (size_t k = 0; k < count; k++) {
        const uint32_t i = job->part->index[at[k]];
        if (job->cells) job->cells[i] = cell[k];
        if (job->cells && cell[k].certain) job->area[i] = area[k];
        if (!job->sums) continue;
        if (pairs[k].alike && !in->sites->patch_labels && !(in->kept && in->kept[i])) {
            add_nearest(pairs[k].nearest, sums);
            sums->energy += pairs[k].energy / energy_cotangent.ideal;
        } else
            measure_point(job, at[k], sums);
    }
}

static void pair_chunk(void *context, int worker, size_t begin, size_t end)
{
    const pair_job *job = context;
    (void)worker;
    pair_sums sums = {.nearest = INFINITY};
    uint32_t at[PLANAR_CELLS_ONCE];
    size_t count = 0;
    for (size_t k = begin; k < end; k++) {
        at[count] = (uint32_t)k;
        count += partition_owns(job->part, k);
        if (count < PLANAR_CELLS_ONCE && k + 1 < end) continue;
        if (count > 0) measure_points(job, at, count, &sums);
        count = 0;
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
    ok = ok && threads_may_go_on(pool, e);
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
    bool borders;
} mean_job;

static void mean_chunk(void *context, int worker, size_t begin, size_t end)
{
    const mean_job *job = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        const uint32_t i = job->part->index[k];
        if (partition_owns(job->part, k) && job->cells[i].certain)
            job->mean[i] = planar_cell_mean(job->part, job->borders, (uint32_t)k, job->value);
    }
}

bool pair_measures_means(const pair_measures_input *in, const planar_cell *cells, const double *value,
                         threads *pool, double *mean, error *e)
{
    lists l;
    bool ok = open_lists(in, pool, &l, e);
    for (size_t k = 0; ok && k < l.all.count; k++) {
        ok = partition_fill(&l.cut, &l.all, k, pool, &l.part, e);
        if (ok)
            threads_run(pool, l.part.count, CHUNK, mean_chunk,
                        &(mean_job){&l.part, cells, value, mean, in->borders});
    }
    close_lists(&l);
    return ok && threads_may_go_on(pool, e);
}
