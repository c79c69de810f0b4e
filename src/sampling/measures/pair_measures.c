// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/pair_measures.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "sampling/packing/energy.h"
#include "geometry/space/packing.h"
#include "sampling/voronoi/partitions.h"
#include "sampling/voronoi/resolution.h"
#include "sampling/voronoi/voronoi.h"

static const char what[] = "the measures of pairs of points";

/* Points in a chunk of work, and in a partial sum. */
enum { CHUNK = 256 };
/* Chunks of which the sides are in memory at once. */
enum { CHUNKS_AT_ONCE = 128 };
/* Pairs whose energies are summed at once. */
enum { BATCH = 8 * ENERGY_LANES };
/* Minimum distance in the energy, as a fraction of the support: the energy is not bounded at 0. */
static const double CLOSEST = 1e-6;

/* Sums of one chunk. */
typedef struct pair_sums {
    double nearest; /* the smallest relative distance */
    size_t close, coincident, thin;
} pair_sums;

typedef struct pair_job {
    const pair_measures_input *in;
    const partition *part;
    size_t first;    /* point of the partition */
    pair_sums *sums; /* of each chunk */
    /* of each point, to the opposite wall, in spacings, and its energy; NULL: only cells are computed */
    float *gap, *energy;
    planar_cells *cells;        /* or NULL */
    voronoi_side *side;         /* of each chunk: its sides */
    uint32_t *side_count;
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

/* A pair of points, from the partition's copies. */
typedef struct pair {
    double distance, facing;
} pair;

static pair pair_at(const pair_job *job, uint32_t at, uint32_t other)
{
    const partition *p = job->part;
    const sites *s = job->in->sites;
    const bool plain = !s->patch_labels && (!p->flags || !(p->flags[at] | p->flags[other]));
    return (pair){vec3_norm(vec3_sub(p->position[at], p->position[other])),
                  plain ? vec3_dot(p->normal[at], p->normal[other])
                        : sites_facing_pair(s, p->index[at], p->index[other])};
}

static void measure_point(const pair_job *job, uint32_t at, pair_sums *sums)
{
    const pair_measures_input *in = job->in;
    const sites *s = in->sites;
    const partition *part = job->part;
    const uint32_t i = part->index[at], *list = neighbours_list(part->near, at);
    const double h = part->spacing[at], support = packing_support(in->sized ? h : in->h);
    energy_batch b;
    double nearest = INFINITY, gap = INFINITY;
    b.count = 0;
    b.energy = 0;
    for (uint32_t k = 0; k < part->near->list_count[at]; k++) {
        const uint32_t j = part->index[list[k]];
        const pair p = pair_at(job, at, list[k]);
        const double mean = 0.5 * (h + part->spacing[list[k]]), size = mean / h;
        const bool together = !in->pieces || s->piece[i] == s->piece[j];
        if (!(p.facing > SITES_OPPOSITE)) {
            gap = fmin(gap, wall_gap(in, i, j, p.distance, mean));
        } else if (together && !(in->kept && in->kept[i] && in->kept[j])) {
            nearest = p.distance < nearest * mean ? p.distance / mean : nearest;
        }
        if (p.facing <= VORONOI_OPPOSITE_COSINE || !together) continue;
        const double u = p.distance / (support * (in->sized ? size : 1));
        add_pair(&b, u * u, in->sized ? size * size : 1);
    }
    sum_batch(&b);
    sums->nearest = fmin(sums->nearest, nearest);
    sums->close += nearest < MEASURES_CLOSE;
    sums->coincident += nearest < MEASURES_COINCIDENT;
    sums->thin += gap < RESOLUTION_GAP;
    job->energy[i] = (float)(b.energy / energy_cotangent.ideal);
    job->gap[i] = (float)gap;
}

static void pair_chunk(void *context, int worker, size_t begin, size_t end)
{
    const pair_job *job = context;
    const size_t chunk = begin / CHUNK;
    const uint32_t *piece = job->in->pieces ? job->in->sites->piece : NULL;
    (void)worker;
    pair_sums sums = {.nearest = INFINITY};
    uint32_t sides = 0;
    for (size_t k = job->first + begin; k < job->first + end; k++) {
        if (!partition_owns(job->part, k)) continue;
        if (job->cells)
            sides += (uint32_t)planar_cells_set(job->cells, job->part, piece, (uint32_t)k,
                                                job->side + CHUNK * PLANAR_CELLS_SIDES * chunk + sides);
        if (job->gap) measure_point(job, (uint32_t)k, &sums);
    }
    job->sums[chunk] = sums;
    if (job->cells) job->side_count[chunk] = sides;
}

static void add_sums(pair_sums *to, const pair_sums *s)
{
    to->nearest = fmin(to->nearest, s->nearest);
    to->close += s->close;
    to->coincident += s->coincident;
    to->thin += s->thin;
}

static int compare_numbers(const void *a, const void *b)
{
    const float p = *(const float *)a, q = *(const float *)b;
    return (p > q) - (p < q);
}

/* See measures.thin_factor; sorts the gaps if more than the allowed ones are small. */
static double thin_factor(float *gap, size_t count, size_t thin)
{
    const size_t allowed = (size_t)(MEASURES_THIN_SHARE * (double)count);
    if (thin <= allowed) return 1;
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

/* The first normal of each point, in an array that the caller frees; *copied is NULL if the sites have just
 * these. */
static bool first_normals(const sites *s, const vec3 **out, vec3 **copied, error *e)
{
    *copied = NULL;
    *out = s->normal;
    if (s->side[s->count] == s->count) return true;
    *out = *copied = mem_array(s->count, sizeof **copied, what, e);
    for (size_t i = 0; *copied && i < s->count; i++) (*copied)[i] = s->normal[s->side[i]];
    return *copied != NULL;
}

static void conclude(const pair_sums *whole, float *gap, size_t count, measures *out)
{
    const double n = (double)count;
    out->thin_factor = thin_factor(gap, count, whole->thin);
    out->min_spacing_ratio = isfinite(whole->nearest) ? whole->nearest : NAN;
    out->close_share = (double)whole->close / n;
    out->coincident = whole->coincident;
    out->thin_count = whole->thin;
}

/* Arrays for the chunks that are computed at once. */
static bool reserve_chunks(pair_job *job, error *e)
{
    const size_t chunks = CHUNKS_AT_ONCE;
    job->sums = mem_array(chunks, sizeof *job->sums, what, e);
    if (!job->sums || !job->cells) return job->sums != NULL;
    job->side = mem_array(CHUNK * PLANAR_CELLS_SIDES * chunks, sizeof *job->side, what, e);
    job->side_count = mem_array(chunks, sizeof *job->side_count, what, e);
    return job->side && job->side_count;
}

/* What the chunks found, in their order. */
static bool collect_chunks(const pair_job *job, size_t count, pair_sums *whole, error *e)
{
    planar_cells *c = job->cells;
    for (size_t k = 0; k < count; k++) {
        add_sums(whole, &job->sums[k]);
        if (!c) continue;
        if (!planar_cells_reserve(c, job->side_count[k], e)) return false;
        memcpy(c->side + c->side_count, job->side + CHUNK * PLANAR_CELLS_SIDES * k,
               job->side_count[k] * sizeof *c->side);
        c->side_count += job->side_count[k];
    }
    return true;
}

static bool measure_partition(pair_job *job, threads *pool, pair_sums *whole, error *e)
{
    bool ok = true;
    for (job->first = 0; ok && job->first < job->part->count; job->first += CHUNK * CHUNKS_AT_ONCE) {
        const size_t left = job->part->count - job->first,
                     count = left < CHUNK * CHUNKS_AT_ONCE ? left : CHUNK * CHUNKS_AT_ONCE;
        threads_run(pool, count, CHUNK, pair_chunk, job);
        ok = collect_chunks(job, (count + CHUNK - 1) / CHUNK, whole, e);
    }
    return ok;
}

bool pair_measures_take(const pair_measures_input *in, threads *pool, planar_cells *cells, float *energy,
                        measures *out, error *e)
{
    const sites *s = in->sites;
    const vec3 *normal = NULL;
    vec3 *copied = NULL;
    partitions all = {0};
    partition part = {0};
    pair_sums whole = {.nearest = INFINITY};
    pair_job job = {.in = in, .part = &part, .energy = energy, .cells = cells};
    job.gap = out ? mem_array(s->count, sizeof *job.gap, what, e) : NULL;
    bool ok = (job.gap || !out) && first_normals(s, &normal, &copied, e);
    const partitions_input cut = {s->count, s->position, normal, s->spacing, NULL, in->odd, reach_of(in)};
    ok = ok && partitions_cut(&cut, pool, &all, e) && reserve_chunks(&job, e);
    for (size_t k = 0; ok && k < all.count; k++) {
        ok = partition_fill(&cut, &all, k, pool, &part, e) && measure_partition(&job, pool, &whole, e);
    }
    ok = ok && (!threads_stopped(pool) || error_set(e, ERROR_CANCELLED, "stopped"));
    if (ok && out) conclude(&whole, job.gap, s->count, out);
    partition_free(&part);
    partitions_free(&all);
    free(job.sums);
    free(job.side);
    free(job.side_count);
    free(job.gap);
    free(copied);
    return ok;
}
