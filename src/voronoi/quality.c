#include "voronoi/quality.h"

#include <stdlib.h>

#include "base/isa.h"
#include "base/memory.h"
#include "packing/energy.h"
#include "packing/packing.h"
#include "voronoi/partitions.h"
#include "voronoi/star_lanes.h"
#include "voronoi/voronoi.h"

/* A request whose spacings differ by less than this factor is even: the slope against it means nothing. */
static const double EVEN_REQUEST = 1.05;
/* With fewer measured points than this a fraction says nothing of those that are not measured. */
static const double LEAST_MEASURED = 20;
/* Two points never come closer than this fraction of the support as far as the energy is concerned. */
static const double CLOSEST = 1e-6;

/* Who is within two spacings of a row is no farther than this from one of it. */
static const double ROW_REACH = 2.07;

/* A packing in perfect order whose spacing grows by g per distance is a lattice under the exponential map. Over what is requested
 * its cells are so many g^2 larger, and energies so many g^2 more; up to a g of 0.3 to 3 % of that, and beyond it counts no more. */
static const double GROWTH_CELL = 5.0 / 12, GROWTH_ENERGY = 0.668, GROWTH_MOST = 0.3;

/* Of more points than this the angles around some are measured. */
static const size_t MOST_TURNS = 50000;

/* Points in a chunk of work, and in a partial sum. */
#define CHUNK 256

/* Moments of a set of values. */
typedef struct moments {
    double n, sum, squares;
} moments;

/* What is summed of the cells of some points. */
typedef struct cell_sums {
    double hex;
    moments edge, area;
} cell_sums;

/* What a chunk of points adds to the measures; all but `degrees` and `boundary` without the points near boundaries. */
typedef struct tally {
    double degrees; /* sum of 6 - degree */
    double boundary, inner, energy, nearest;
    cell_sums resolved, others;
    moments ratio;
    double growth2; /* sum over the points with a cell */
    moments turn;   /* of some of these: the angles around them over a full turn */
    double finest, coarsest;
    double sized, sx, sy, sxx, sxy; /* of the logarithms of requested and local spacing, where there is one */
} tally;

/* What is measured at a time: a partition of the points and those around. */
typedef struct quality_part {
    partition partition;
    quality_input in; /* of the partition's points, in their order */
    bool *unresolved;
    bool *rim;         /* who is near a boundary */
    tally *tally;      /* per chunk */
    bool graded;       /* spacings differ enough for a slope */
    size_t turn_every; /* of one point of so many the angles around it are measured */
} quality_part;

typedef struct measure_job {
    const quality_part *part;
    const quality_input *in; /* the part's */
    voronoi_sites sites;
    double *local, *degree; /* of all points; either may be NULL */
} measure_job;

/* The cosine between two normals, as far as their sides mean something. */
static double facing(const quality_input *in, uint32_t i, uint32_t j)
{
    double cosine = vec3_dot(in->normal[i], in->normal[j]);
    return in->flags && in->flags[i] & PACKING_ONE_SIDED ? fabs(cosine) : cosine;
}

static void count_value(moments *m, double value)
{
    m->n++;
    m->sum += value;
    m->squares += value * value;
}

/* Pairs that wait to be summed. */
#define PAIR_BATCH (2 * ENERGY_LANES)

typedef struct pair_batch {
    size_t count;
    double u2[PAIR_BATCH], weight[PAIR_BATCH];
    double energy;
} pair_batch;

static void sum_pairs(pair_batch *b)
{
    while (b->count % ENERGY_LANES) {
        b->u2[b->count] = 0.5;
        b->weight[b->count++] = 0;
    }
    b->energy += energy_cotangent_sum(b->u2, b->weight, b->count);
    b->count = 0;
}

static void add_pair(pair_batch *b, double u2, double weight)
{
    if (b->count == PAIR_BATCH) sum_pairs(b);
    b->u2[b->count] = u2 > CLOSEST * CLOSEST ? u2 : CLOSEST * CLOSEST;
    b->weight[b->count] = weight;
    b->count += u2 < 1; /* as good as random: no branch */
}

/* The energy of i, as quality.energy_excess has it, and the smallest of its neighbours' distances, squared and over the squared mean
 * of both spacings. */
static double energy_of(const measure_job *job, uint32_t i, double *nearest2)
{
    const quality_input *in = job->in;
    const uint32_t *list = neighbours_list(job->sites.near, i);
    const double over = 1 / in->spacing[i], support = packing_support(in->sized ? in->spacing[i] : in->h),
                 over2 = 1 / (support * support);
    pair_batch b; /* its arrays are filled as far as they are read */
    b.count = 0;
    b.energy = 0;
    *nearest2 = INFINITY;
    for (uint32_t k = 0; k < job->sites.near->list_count[i]; k++) {
        const uint32_t j = list[k];
        if (facing(in, i, j) <= VORONOI_OTHER_SIDE) continue;
        const double square = vec3_norm2(vec3_sub(in->position[i], in->position[j])),
                     size = 0.5 * (1 + in->spacing[j] * over), size2 = size * size, smaller = 1 / size2,
                     relative2 = square * (over * over) * smaller;
        *nearest2 = relative2 < *nearest2 ? relative2 : *nearest2;
        add_pair(&b, square * over2 * (in->sized ? smaller : 1), in->sized ? size2 : 1);
    }
    sum_pairs(&b);
    return b.energy;
}

/* The pairs of some points' lists, entry by entry; u2 is 1 of those that do not count. */
typedef struct row_pairs {
    double over[STAR_LANES], support[STAR_LANES]; /* 1 / spacing */
    double u2[STAR_ROWS][STAR_LANES], weight[STAR_ROWS][STAR_LANES];
} row_pairs;

ISA_CLONES static void weigh_rows(const star_rows *rows, bool sized, row_pairs *out,
                                  double nearest2[STAR_LANES])
{
    const row over = *(const row *)out->over, support = *(const row *)out->support,
              over2 = 1 / (support * support), one = ALL(1.0);
    const mask by_size = (mask){0} - (int64_t)sized;
    mask length;
    row least = ALL(INFINITY);
    for (int l = 0; l < STAR_LANES; l++) length[l] = rows->count[l];
    for (uint32_t k = 0; k < rows->most; k++) {
        const row square = *(const row *)rows->square[k],
                  size = 0.5 * (1 + *(const row *)rows->spacing[k] * over), size2 = size * size,
                  smaller = 1 / size2, relative2 = square * (over * over) * smaller;
        const mask counts = (length > (int64_t)k) & (*(const row *)rows->facing[k] > VORONOI_OTHER_SIDE),
                   nearer = counts & (relative2 < least);
        least = CHOOSE(nearer, relative2, least);
        *(row *)out->u2[k] = CHOOSE(counts, square * over2 * CHOOSE(by_size, smaller, one), one);
        *(row *)out->weight[k] = CHOOSE(by_size, size2, one);
    }
    *(row *)nearest2 = least;
}

/* energy_of the points of `rows`, to the last bit. */
static void energies_of(const measure_job *job, const star_rows *rows, uint32_t count,
                        double energy[STAR_LANES], double nearest2[STAR_LANES])
{
    row_pairs pairs;
    for (uint32_t l = 0; l < STAR_LANES; l++) {
        pairs.over[l] = 1 / job->in->spacing[rows->point[l]];
        pairs.support[l] = packing_support(job->in->sized ? job->in->spacing[rows->point[l]] : job->in->h);
    }
    weigh_rows(rows, job->in->sized, &pairs, nearest2);
    for (uint32_t l = 0; l < count; l++) {
        pair_batch b;
        b.count = 0;
        b.energy = 0;
        for (uint32_t k = 0; k < rows->count[l]; k++) add_pair(&b, pairs.u2[k][l], pairs.weight[k][l]);
        sum_pairs(&b);
        energy[l] = b.energy;
    }
}

static bool is_in_reach(const quality_input *in, uint32_t i, uint32_t fixed)
{
    const double reach = ROW_REACH * 0.5 * (in->spacing[i] + in->spacing[fixed]);
    return in->flags[fixed] & PACKING_FIXED &&
           vec3_norm2(vec3_sub(in->position[fixed], in->position[i])) < reach * reach;
}

/* Whether the sheets of two points meet in a sharp edge, next to both: its row tells them apart. */
static bool meet_in_edge(const quality_input *in, uint32_t i, uint32_t j)
{
    const uint8_t at = PACKING_FIXED | PACKING_AT_WEDGE;
    return in->flags && in->flags[i] & at && in->flags[j] & at;
}

static bool is_unresolved(const measure_job *job, uint32_t i)
{
    const quality_input *in = job->in;
    const uint32_t *list = neighbours_list(job->sites.near, i);
    for (uint32_t k = 0; k < job->sites.near->list_count[i]; k++) {
        uint32_t j = list[k];
        if (facing(in, i, j) >= QUALITY_SHEET_FACING) continue;
        vec3 r = vec3_sub(in->position[j], in->position[i]);
        double mean = 0.5 * (in->spacing[i] + in->spacing[j]), reach = QUALITY_SHEET_REACH * mean;
        double gap = fmin(fabs(vec3_dot(in->normal[i], r)), fabs(vec3_dot(in->normal[j], r)));
        if (gap < QUALITY_SHEET_GAP * mean && vec3_norm2(r) < reach * reach && !meet_in_edge(in, i, j))
            return true;
    }
    return false;
}

/* Within two spacings of a face, or of a curve: those of a row there are no farther apart than a spacing, or little more. */
static bool is_near_boundary(const measure_job *job, uint32_t i)
{
    const quality_input *in = job->in;
    if (in->open && packing_is_near_boundary(in->domain, in->position[i], in->spacing[i])) return true;
    if (!in->flags) return false;
    if (in->flags[i] & PACKING_FIXED) return true;
    const uint32_t *list = neighbours_list(job->sites.near, i);
    for (uint32_t k = 0; k < job->sites.near->list_count[i]; k++)
        if (is_in_reach(in, i, list[k])) return true;
    return false;
}

static void mark_chunk(void *context, int worker, size_t begin, size_t end)
{
    const measure_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        job->part->unresolved[i] = is_unresolved(job, (uint32_t)i);
        job->part->rim[i] = is_near_boundary(job, (uint32_t)i);
    }
}

static bool has_cell(const measure_job *job, uint32_t i, const voronoi_star *star)
{
    bool has = star->count > 0 && !job->part->unresolved[i] && !star->pinched;
    for (uint32_t k = 0; k < star->count; k++) has &= !job->part->unresolved[star->point[k]];
    return has;
}

/* An edge counts from either end. */
static void sum_cell(const measure_job *job, uint32_t i, const voronoi_star *star, double area, cell_sums *c)
{
    const quality_input *in = job->in;
    c->hex += star->count == 6;
    count_value(&c->area, area / (in->spacing[i] * in->spacing[i]));
    for (uint32_t k = 0; k < star->count; k++) {
        uint32_t j = star->point[k];
        if (!job->part->rim[j])
            count_value(&c->edge, star->distance[k] / (0.5 * (in->spacing[i] + in->spacing[j])));
    }
}

/* The square of how much the requested spacing grows per distance; one direction has half of it in the mean. */
static double growth2_at(const quality_input *in, uint32_t i, const voronoi_star *star)
{
    double sum = 0, count = 0;
    for (uint32_t k = 0; k < star->count; k++) {
        const uint32_t j = star->point[k];
        const double more = in->spacing[j] - in->spacing[i];
        if (!(star->distance[k] > 0) || facing(in, i, j) <= VORONOI_OTHER_SIDE) continue;
        sum += more * more / (star->distance[k] * star->distance[k]);
        count++;
    }
    return count > 0 ? fmin(2 * sum / count, GROWTH_MOST * GROWTH_MOST) : 0;
}

/* The angles of the triangles around a point over a full turn: less than 1 on a cap, more on a saddle. */
static double turn_around(const quality_input *in, uint32_t i, const voronoi_star *star)
{
    double sum = 0;
    for (uint32_t k = 0; k < star->triangle_count; k++) {
        const vec3 a = vec3_sub(in->position[star->point[star->corner[k][0]]], in->position[i]),
                   b = vec3_sub(in->position[star->point[star->corner[k][1]]], in->position[i]);
        sum += atan2(vec3_norm(vec3_cross(a, b)), vec3_dot(a, b));
    }
    return sum / (2 * M_PI);
}

static void tally_logarithms(double requested, double local, tally *t)
{
    double x = log(requested), y = log(local);
    t->sized++;
    t->sx += x;
    t->sy += y;
    t->sxx += x * x;
    t->sxy += x * y;
}

static void tally_point(const measure_job *job, uint32_t i, const voronoi_star *star, double energy,
                        double nearest2, tally *t)
{
    const quality_input *in = job->in;
    double spacing = in->spacing[i], area = voronoi_star_area(star),
           local = packing_spacing(fmax(area, 0), 1);
    bool whole = area > 0 && !star->pinched && !(in->flags && in->flags[i] & PACKING_FIXED);
    if (job->local) job->local[job->part->partition.index[i]] = whole ? local : spacing;
    if (job->degree) job->degree[job->part->partition.index[i]] = star->count;
    t->degrees += 6.0 - star->count;
    if (job->part->rim[i]) {
        t->boundary++;
        return;
    }
    t->energy += energy;
    t->nearest = fmin(t->nearest, nearest2);
    t->inner++;
    t->finest = fmin(t->finest, spacing);
    t->coarsest = fmax(t->coarsest, spacing);
    const bool resolved = has_cell(job, i, star);
    sum_cell(job, i, star, area, resolved ? &t->resolved : &t->others);
    if (!resolved) return;
    count_value(&t->ratio, local / spacing);
    if (job->part->partition.index[i] % job->part->turn_every == 0)
        count_value(&t->turn, turn_around(in, i, star));
    if (job->part->graded) t->growth2 += growth2_at(in, i, star);
    if (job->part->graded && local > 0) tally_logarithms(spacing, local, t);
}

static tally tally_empty(void)
{
    return (tally){.nearest = INFINITY, .finest = INFINITY};
}

static bool is_measured(const measure_job *job, size_t i)
{
    const partition *s = &job->part->partition;
    return partition_owns(s, i) && (job->in->every == 0 || s->index[i] % job->in->every == 0);
}

static void tally_chunk(void *context, int worker, size_t begin, size_t end)
{
    const measure_job *job = context;
    (void)worker;
    tally t = tally_empty();
    star_rows rows = {0};
    voronoi_star star[STAR_LANES];
    for (size_t i = begin; i < end;) {
        uint32_t point[STAR_LANES], count = 0;
        for (; i < end && count < STAR_LANES; i++)
            if (is_measured(job, i)) point[count++] = (uint32_t)i;
        if (count == 0) break;
        /* one-sided normals face another way in energies */
        const bool told = star_lanes_at(&job->sites, point, count, &rows, star) && !job->in->flags;
        double energy[STAR_LANES], nearest2[STAR_LANES];
        if (told)
            energies_of(job, &rows, count, energy, nearest2);
        else
            for (size_t l = 0; l < count; l++) energy[l] = energy_of(job, point[l], &nearest2[l]);
        for (size_t l = 0; l < count; l++) tally_point(job, point[l], &star[l], energy[l], nearest2[l], &t);
    }
    job->part->tally[begin / CHUNK] = t;
}

static void add_moments(moments *m, const moments *other)
{
    m->n += other->n;
    m->sum += other->sum;
    m->squares += other->squares;
}

static void add_cells(cell_sums *c, const cell_sums *other)
{
    c->hex += other->hex;
    add_moments(&c->edge, &other->edge);
    add_moments(&c->area, &other->area);
}

static void add_tally(tally *t, const tally *other)
{
    t->degrees += other->degrees;
    t->boundary += other->boundary;
    t->inner += other->inner;
    t->energy += other->energy;
    t->nearest = fmin(t->nearest, other->nearest);
    add_cells(&t->resolved, &other->resolved);
    add_cells(&t->others, &other->others);
    add_moments(&t->ratio, &other->ratio);
    t->growth2 += other->growth2;
    add_moments(&t->turn, &other->turn);
    t->finest = fmin(t->finest, other->finest);
    t->coarsest = fmax(t->coarsest, other->coarsest);
    t->sized += other->sized;
    t->sx += other->sx;
    t->sy += other->sy;
    t->sxx += other->sxx;
    t->sxy += other->sxy;
}

/* Coefficient of variation; NAN of fewer than two values. */
static double variation(const moments *m)
{
    if (m->n < 2 || !(m->sum > 0)) return NAN;
    double mean = m->sum / m->n;
    return sqrt(fmax(m->squares / m->n - mean * mean, 0)) / mean;
}

static quality_cells conclude_cells(const cell_sums *c)
{
    double n = c->area.n;
    return (quality_cells){n > 0 ? c->hex / n : NAN, variation(&c->edge), variation(&c->area)};
}

/* See quality.disorder. With n neighbours, 6 times the turn (Gauss and Bonnet), a cell is n / 3 triangles, whose sides are as
 * sqrt(6 / n). */
static double disorder(const tally *t, double energy_excess)
{
    const moments *area = &t->resolved.area;
    if (!(area->sum > 0 && t->turn.sum > 0)) return energy_excess;
    const double turn = t->turn.sum / t->turn.n, growth2 = t->growth2 / area->n,
                 ordered = packing_cell_area(1) * (1 + GROWTH_CELL * growth2) * turn,
                 denser = pow(ordered * area->n / area->sum, 0.5 * energy_cotangent.ideal_slope);
    return (1 + energy_excess) / (turn * denser * (1 + GROWTH_ENERGY * growth2)) - 1;
}

static quality conclude(const tally *t)
{
    double n = t->resolved.area.n;
    cell_sums all = t->resolved;
    add_cells(&all, &t->others);
    quality q = {.all = conclude_cells(&all),
                 .resolved = {NAN, NAN, NAN},
                 .resolved_count = (size_t)n,
                 .resolved_share = n / t->inner, /* NAN of nothing but boundaries, as energy_excess */
                 .energy_excess = t->energy / t->inner / energy_cotangent.ideal - 1,
                 .min_spacing_ratio = isfinite(t->nearest) ? sqrt(t->nearest) : NAN,
                 .rim_count = (size_t)t->boundary,
                 .unresolved_count = (size_t)(t->inner - n),
                 .euler = t->degrees / 6,
                 .grading_cv = NAN,
                 .grading_exponent = NAN};
    q.disorder = q.energy_excess;
    if (n < LEAST_MEASURED && n < t->inner) return q; /* too few to speak for the others */
    q.resolved = conclude_cells(&t->resolved);
    q.disorder = disorder(t, q.energy_excess);
    q.grading_cv = variation(&t->ratio);
    if (!(t->coarsest > EVEN_REQUEST * t->finest))
        q.grading_exponent = n > 0 ? 1 : NAN;
    else if (t->sized > 1)
        q.grading_exponent = (t->sxy - t->sx * t->sy / t->sized) / (t->sxx - t->sx * t->sx / t->sized);
    return q;
}

/* What is to be known of all points before any is measured. */
typedef struct extent {
    double finest, coarsest; /* spacing */
    double reach;            /* of the lists: that of the Voronoi diagram and of the energies */
} extent;

static extent extent_of(const quality_input *in)
{
    extent x = {.finest = INFINITY, .coarsest = 0};
    for (size_t i = 0; i < in->count; i++) { /* without fmin, which is a call */
        x.finest = in->spacing[i] < x.finest ? in->spacing[i] : x.finest;
        x.coarsest = in->spacing[i] > x.coarsest ? in->spacing[i] : x.coarsest;
    }
    x.reach = in->sized ? VORONOI_REACH : fmax(VORONOI_REACH, packing_support(in->h) / x.finest);
    return x;
}

static void free_part(quality_part *p)
{
    partition_free(&p->partition);
    free(p->unresolved);
    free(p->rim);
    free(p->tally);
}

/* Room for the largest of all. */
static bool reserve_part(const partitions *all, quality_part *out, error *e)
{
    const char *what = "the quality measures";
    out->unresolved = mem_array(all->most, sizeof *out->unresolved, what, e);
    out->tally = mem_array(all->most / CHUNK + 1, sizeof *out->tally, what, e);
    out->rim = mem_array(all->most, sizeof *out->rim, what, e);
    return out->unresolved && out->rim && out->tally;
}

static bool fill_part(const quality_input *in, const partitions_input *cut, const partitions *all, size_t k,
                      threads *pool, quality_part *out, error *e)
{
    const partition *s = &out->partition;
    if (!partition_fill(cut, all, k, pool, &out->partition, e)) return false;
    out->in = *in;
    out->in.count = s->count;
    out->in.position = s->position;
    out->in.normal = s->normal;
    out->in.spacing = s->spacing;
    out->in.label = s->label;
    out->in.flags = s->flags;
    return true;
}

bool quality_measure(const quality_input *in, threads *pool, double *spacing_local, double *degree,
                     quality *out, error *e)
{
    const extent x = extent_of(in);
    const partitions_input cut = {in->count, in->position, in->normal, in->spacing,
                                  in->label, in->flags,    x.reach};
    partitions all;
    quality_part p = {.graded = x.coarsest > EVEN_REQUEST * x.finest,
                      .turn_every = 1 + in->count / MOST_TURNS};
    bool ok = partitions_cut(&cut, pool, &all, e) && reserve_part(&all, &p, e);
    tally whole = tally_empty();
    for (size_t k = 0; ok && k < all.count; k++) {
        ok = fill_part(in, &cut, &all, k, pool, &p, e);
        const partition *s = &p.partition;
        measure_job job = {&p,
                           &p.in,
                           {s->position, s->normal, s->spacing, s->near, s->flags, s->index},
                           spacing_local,
                           degree};
        if (ok) threads_run(pool, s->count, CHUNK, mark_chunk, &job);
        if (ok) threads_run(pool, s->count, CHUNK, tally_chunk, &job);
        for (size_t c = 0; ok && c < (s->count + CHUNK - 1) / CHUNK; c++) add_tally(&whole, &p.tally[c]);
    }
    free_part(&p);
    partitions_free(&all);
    if (ok) *out = conclude(&whole);
    return ok;
}
