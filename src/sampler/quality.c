#include "sampler/quality.h"

#include <stdlib.h>

#include "base/memory.h"
#include "sampler/energy.h"
#include "sampler/neighbours.h"
#include "sampler/voronoi.h"

/* A request whose spacings differ by less than this factor is even: the slope against it means nothing. */
static const double EVEN_REQUEST = 1.05;
/* Two points never come closer than this fraction of the support as far as the energy is concerned. */
static const double CLOSEST = 1e-6;

/* Points in a chunk of work, and in a partial sum. */
#define CHUNK 256

/* Moments of a set of values. */
typedef struct moments {
    double n, sum, squares;
} moments;

/* What a chunk of points adds to the measures; all but `degrees` and `rims` without the points near rims. */
typedef struct tally {
    double degrees; /* sum of 6 - degree */
    double rims, hex, alpha, energy, nearest;
    moments edge, area, ratio;
    double finest, coarsest;
    double sized, sx, sy, sxx, sxy; /* of the logarithms of requested and local spacing, where there is one */
} tally;

typedef struct measure_job {
    const quality_input *in;
    voronoi_sites sites;
    bool graded;  /* spacings differ enough for a slope */
    tally *tally; /* per chunk */
    double *local;
    uint8_t *degree; /* may be NULL, as may local */
} measure_job;

static double alpha_of(const quality_input *in, size_t i)
{
    return in->alpha ? in->alpha[i] : 1;
}

static bool is_on_rim(const quality_input *in, size_t i)
{
    return in->open && !bbox_contains(bbox_grow(in->domain, -2 * in->spacing[i]), in->position[i]);
}

static void count_value(moments *m, double value)
{
    m->n++;
    m->sum += value;
    m->squares += value * value;
}

/* Pairs that wait to be summed. */
#define BATCH (2 * ENERGY_LANES)

typedef struct batch {
    size_t count;
    double u2[BATCH], weight[BATCH];
    double energy;
} batch;

static void sum_batch(batch *b)
{
    while (b->count % ENERGY_LANES) {
        b->u2[b->count] = 0.5;
        b->weight[b->count++] = 0;
    }
    b->energy += energy_cotangent_sum(b->u2, b->weight, b->count);
    b->count = 0;
}

/* The energy of i, as quality.energy_excess has it, and the smallest of its neighbours' distances, squared
 * and over the squared mean of the spacings. */
static double energy_of(const measure_job *job, uint32_t i, double *nearest2)
{
    const quality_input *in = job->in;
    const uint32_t *list = neighbours_list(job->sites.near, i);
    batch b = {.count = 0};
    double over = 1 / in->spacing[i], alpha = alpha_of(in, i), least = INFINITY;
    double support = sqrt(3) * (in->sized ? in->spacing[i] : in->h), over2 = 1 / (support * support);
    for (uint32_t k = 0; k < job->sites.near->list_count[i]; k++) {
        uint32_t j = list[k];
        if (vec3_dot(in->normal[i], in->normal[j]) <= VORONOI_OTHER_SIDE) continue;
        double square = vec3_norm2(vec3_sub(in->position[i], in->position[j]));
        double size = 0.5 * (1 + in->spacing[j] * over), size2 = size * size;
        double relative2 = square * over * over / size2;
        least = relative2 < least ? relative2 : least;
        if (!in->sized) size2 = 1;
        double u2 = square * over2 / size2;
        if (b.count == BATCH) sum_batch(&b);
        b.u2[b.count] = u2 > CLOSEST * CLOSEST ? u2 : CLOSEST * CLOSEST;
        b.weight[b.count] = 0.5 * (alpha + alpha_of(in, j)) * size2;
        b.count += u2 < 1; /* as good as random: no branch */
    }
    sum_batch(&b);
    *nearest2 = least;
    return b.energy;
}

static double area_of(const voronoi_star *star)
{
    double area = 0;
    for (uint32_t k = 0; k < voronoi_star_held(star); k++) area += 0.25 * star->distance[k] * star->edge[k];
    return area;
}

/* Edges belong to their end of lower index. */
static void tally_edges(const quality_input *in, uint32_t i, const voronoi_star *star, tally *t)
{
    for (uint32_t k = 0; k < voronoi_star_held(star); k++) {
        uint32_t j = star->point[k];
        if (i < j && !is_on_rim(in, j))
            count_value(&t->edge, star->distance[k] / (0.5 * (in->spacing[i] + in->spacing[j])));
    }
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

static void tally_point(const measure_job *job, uint32_t i, tally *t)
{
    const quality_input *in = job->in;
    voronoi_star star;
    voronoi_star_at(&job->sites, i, &star);
    double spacing = in->spacing[i], area = area_of(&star), local = sqrt(2 * area / sqrt(3));
    if (job->local) job->local[i] = local;
    if (job->degree) job->degree[i] = (uint8_t)(star.count < UINT8_MAX ? star.count : UINT8_MAX);
    t->degrees += 6.0 - star.count;
    if (is_on_rim(in, i)) {
        t->rims++;
        return;
    }
    double nearest2;
    t->energy += energy_of(job, i, &nearest2);
    t->nearest = fmin(t->nearest, nearest2);
    t->alpha += alpha_of(in, i);
    t->hex += star.count == 6;
    t->finest = fmin(t->finest, spacing);
    t->coarsest = fmax(t->coarsest, spacing);
    tally_edges(in, i, &star, t);
    count_value(&t->area, area / (spacing * spacing));
    count_value(&t->ratio, local / spacing);
    if (job->graded && local > 0) tally_logarithms(spacing, local, t);
}

static tally tally_empty(void)
{
    return (tally){.nearest = INFINITY, .finest = INFINITY};
}

static void tally_chunk(void *context, int worker, size_t begin, size_t end)
{
    const measure_job *job = context;
    (void)worker;
    tally t = tally_empty();
    for (size_t i = begin; i < end; i++) tally_point(job, (uint32_t)i, &t);
    job->tally[begin / CHUNK] = t;
}

static void add_moments(moments *m, const moments *other)
{
    m->n += other->n;
    m->sum += other->sum;
    m->squares += other->squares;
}

static void add_tally(tally *t, const tally *other)
{
    t->degrees += other->degrees;
    t->rims += other->rims;
    t->hex += other->hex;
    t->alpha += other->alpha;
    t->energy += other->energy;
    t->nearest = fmin(t->nearest, other->nearest);
    add_moments(&t->edge, &other->edge);
    add_moments(&t->area, &other->area);
    add_moments(&t->ratio, &other->ratio);
    t->finest = fmin(t->finest, other->finest);
    t->coarsest = fmax(t->coarsest, other->coarsest);
    t->sized += other->sized;
    t->sx += other->sx;
    t->sy += other->sy;
    t->sxx += other->sxx;
    t->sxy += other->sxy;
}

/* Coefficient of variation. */
static double variation(const moments *m)
{
    if (m->n < 1 || !(m->sum > 0)) return 0;
    double mean = m->sum / m->n;
    return sqrt(fmax(m->squares / m->n - mean * mean, 0)) / mean;
}

static quality conclude(const tally *t)
{
    quality q = {
        .rim_count = (size_t)t->rims, .euler = t->degrees / 6, .min_spacing_ratio = sqrt(t->nearest)};
    q.grading_exponent = 1;
    if (t->area.n < 1) { /* nothing but rims: there is nothing to say */
        q.hex_fraction = q.edge_cv = q.area_cv = q.energy_excess = q.grading_cv = q.grading_exponent = NAN;
        return q;
    }
    q.hex_fraction = t->hex / t->area.n;
    q.edge_cv = variation(&t->edge);
    q.area_cv = variation(&t->area);
    q.energy_excess = t->energy / t->alpha / energy_cotangent.ideal - 1;
    q.grading_cv = variation(&t->ratio);
    if (t->coarsest > EVEN_REQUEST * t->finest)
        q.grading_exponent = (t->sxy - t->sx * t->sy / t->sized) / (t->sxx - t->sx * t->sx / t->sized);
    return q;
}

static bool is_graded(const quality_input *in)
{
    double finest = INFINITY, coarsest = 0;
    for (size_t i = 0; i < in->count; i++) {
        finest = fmin(finest, in->spacing[i]);
        coarsest = fmax(coarsest, in->spacing[i]);
    }
    return coarsest > EVEN_REQUEST * finest;
}

bool quality_measure(const quality_input *in, threads *pool, double *spacing_local, uint8_t *degree,
                     quality *out, error *e)
{
    bool ok = false;
    size_t n = in->count, chunks = (n + CHUNK - 1) / CHUNK;
    tally *part = mem_array(chunks, sizeof *part, "the quality measures", e), whole = tally_empty();
    neighbours *near = neighbours_new(n, SIZE_MAX, e);
    if (!part || !near) goto done;
    if (!neighbours_build(near, n, in->position, in->spacing, VORONOI_REACH, pool, e)) goto done;
    measure_job job = {.in = in,
                       .sites = {in->position, in->normal, in->spacing, near},
                       .graded = is_graded(in),
                       .tally = part,
                       .local = spacing_local,
                       .degree = degree};
    threads_run(pool, n, CHUNK, tally_chunk, &job);
    for (size_t k = 0; k < chunks; k++) add_tally(&whole, &part[k]);
    *out = conclude(&whole);
    ok = true;
done:
    free(part);
    neighbours_free(near);
    return ok;
}
