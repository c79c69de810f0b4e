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

/* Sheets that points do not tell apart: see the header. */
static const double SHEET_FACING = -0.4, SHEET_REACH = 1.7, SHEET_GAP = 1.2;

/* Points in a chunk of work, and in a partial sum. */
#define CHUNK 256

/* Moments of a set of values. */
typedef struct moments {
    double n, sum, squares;
} moments;

/* What a chunk of points adds to the measures; all but `degrees` and `rims` without the points near rims. */
typedef struct tally {
    double degrees; /* sum of 6 - degree */
    double rims, unresolved, hex, alpha, energy, nearest;
    moments edge, area, ratio;
    double finest, coarsest;
    double sized, sx, sy, sxx, sxy; /* of the logarithms of requested and local spacing, where there is one */
} tally;

/* Points are measured slab by slab along the longest side of their box, so that the lists of neighbours are
 * those of a slab at a time. About as many points as this are in one, but for the largest sets. */
static const size_t SLAB_POINTS = 100000, SLABS_MOST = 16;
enum { BINS = 4096 }; /* of the histogram that slabs are cut by */
/* A star takes the lists of those listed by those listed. */
static const double HALO_REACHES = 3;

typedef struct slab {
    int axis;
    double low, high; /* of its own points */
    quality_input in; /* of them and those around, in their order */
    vec3 *position, *normal;
    double *spacing, *alpha;
    uint32_t *index; /* of each, among all */
    bool *unresolved;
    neighbours *near;
    tally *tally; /* per chunk */
    bool graded;  /* spacings differ enough for a slope */
} slab;

typedef struct measure_job {
    const slab *slab;
    const quality_input *in; /* the slab's */
    voronoi_sites sites;
    double *local; /* of all points, as degree; either may be NULL */
    uint8_t *degree;
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
    for (uint32_t k = 0; k < star->count; k++) area += 0.25 * star->distance[k] * star->edge[k];
    return area;
}

static bool is_unresolved(const measure_job *job, uint32_t i)
{
    const quality_input *in = job->in;
    const uint32_t *list = neighbours_list(job->sites.near, i);
    for (uint32_t k = 0; k < job->sites.near->list_count[i]; k++) {
        uint32_t j = list[k];
        if (vec3_dot(in->normal[i], in->normal[j]) >= SHEET_FACING) continue;
        vec3 r = vec3_sub(in->position[j], in->position[i]);
        double mean = 0.5 * (in->spacing[i] + in->spacing[j]), reach = SHEET_REACH * mean;
        double gap = fmin(fabs(vec3_dot(in->normal[i], r)), fabs(vec3_dot(in->normal[j], r)));
        if (gap < SHEET_GAP * mean && vec3_norm2(r) < reach * reach) return true;
    }
    return false;
}

static void mark_chunk(void *context, int worker, size_t begin, size_t end)
{
    const measure_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) job->slab->unresolved[i] = is_unresolved(job, (uint32_t)i);
}

static bool has_cell(const measure_job *job, uint32_t i, const voronoi_star *star)
{
    bool has = !job->slab->unresolved[i] && !star->pinched;
    for (uint32_t k = 0; k < star->count; k++) has &= !job->slab->unresolved[star->point[k]];
    return has;
}

/* Those of a point that has a cell: an edge counts from either end. */
static void tally_edges(const quality_input *in, uint32_t i, const voronoi_star *star, tally *t)
{
    for (uint32_t k = 0; k < star->count; k++) {
        uint32_t j = star->point[k];
        if (!is_on_rim(in, j))
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
    double spacing = in->spacing[i], area = area_of(&star), local = sqrt(2 * fmax(area, 0) / sqrt(3));
    if (job->local) job->local[job->slab->index[i]] = local;
    if (job->degree)
        job->degree[job->slab->index[i]] = (uint8_t)(star.count < UINT8_MAX ? star.count : UINT8_MAX);
    t->degrees += 6.0 - star.count;
    if (is_on_rim(in, i)) {
        t->rims++;
        return;
    }
    double nearest2;
    t->energy += energy_of(job, i, &nearest2);
    t->nearest = fmin(t->nearest, nearest2);
    t->alpha += alpha_of(in, i);
    t->finest = fmin(t->finest, spacing);
    t->coarsest = fmax(t->coarsest, spacing);
    if (!has_cell(job, i, &star)) {
        t->unresolved++;
        return;
    }
    t->hex += star.count == 6;
    tally_edges(in, i, &star, t);
    count_value(&t->area, area / (spacing * spacing));
    count_value(&t->ratio, local / spacing);
    if (job->slab->graded && local > 0) tally_logarithms(spacing, local, t);
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
    for (size_t i = begin; i < end; i++) {
        double at = vec3_get(job->in->position[i], job->slab->axis);
        if (at >= job->slab->low && at < job->slab->high) tally_point(job, (uint32_t)i, &t);
    }
    job->slab->tally[begin / CHUNK] = t;
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
    t->unresolved += other->unresolved;
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
    quality q = {.rim_count = (size_t)t->rims,
                 .unresolved_count = (size_t)t->unresolved,
                 .euler = t->degrees / 6,
                 .min_spacing_ratio = sqrt(t->nearest)};
    q.grading_exponent = 1;
    q.energy_excess = t->energy / t->alpha / energy_cotangent.ideal - 1; /* NAN of nothing but rims */
    if (t->area.n < 1) { /* no cells: there is nothing to say of them */
        q.hex_fraction = q.edge_cv = q.area_cv = q.grading_cv = q.grading_exponent = NAN;
        return q;
    }
    q.hex_fraction = t->hex / t->area.n;
    q.edge_cv = variation(&t->edge);
    q.area_cv = variation(&t->area);
    q.grading_cv = variation(&t->ratio);
    if (t->coarsest > EVEN_REQUEST * t->finest)
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
    for (size_t i = 0; i < in->count; i++) {
        x.finest = fmin(x.finest, in->spacing[i]);
        x.coarsest = fmax(x.coarsest, in->spacing[i]);
    }
    x.reach = in->sized ? VORONOI_REACH : fmax(VORONOI_REACH, sqrt(3) * in->h / x.finest);
    return x;
}

/* The points in a slab and within `halo` of it; to `out`, if that is given, which has room for them. */
static size_t gather_slab(const quality_input *in, const slab *s, double halo, const slab *out)
{
    size_t found = 0;
    for (size_t i = 0; i < in->count; i++) {
        double at = vec3_get(in->position[i], s->axis);
        if (!(at >= s->low - halo && at < s->high + halo)) continue;
        if (out) {
            out->position[found] = in->position[i];
            out->normal[found] = in->normal[i];
            out->spacing[found] = in->spacing[i];
            out->alpha[found] = alpha_of(in, i);
            out->index[found] = (uint32_t)i;
        }
        found++;
    }
    return found;
}

static void free_slab(slab *s)
{
    free(s->position);
    free(s->normal);
    free(s->spacing);
    free(s->alpha);
    free(s->index);
    free(s->unresolved);
    free(s->tally);
    neighbours_free(s->near);
}

/* The points and the lists of a slab of which axis, low and high are set. */
static bool fill_slab(const quality_input *in, const extent *x, threads *pool, slab *s, error *e)
{
    double halo = HALO_REACHES * x->reach * x->coarsest;
    const char *what = "the quality measures";
    size_t n = gather_slab(in, s, halo, NULL);
    s->position = mem_array(n, sizeof *s->position, what, e);
    s->normal = mem_array(n, sizeof *s->normal, what, e);
    s->spacing = mem_array(n, sizeof *s->spacing, what, e);
    s->alpha = mem_array(n, sizeof *s->alpha, what, e);
    s->index = mem_array(n, sizeof *s->index, what, e);
    s->unresolved = mem_array(n, sizeof *s->unresolved, what, e);
    s->tally = mem_array(n / CHUNK + 1, sizeof *s->tally, what, e);
    s->near = neighbours_new(n, SIZE_MAX, e);
    if (!s->position || !s->normal || !s->spacing || !s->alpha || !s->index || !s->unresolved || !s->tally ||
        !s->near)
        return false;
    gather_slab(in, s, halo, s);
    s->in = *in;
    s->in.count = n;
    s->in.position = s->position;
    s->in.normal = s->normal;
    s->in.spacing = s->spacing;
    s->in.alpha = s->alpha;
    return neighbours_build(s->near, n, s->position, s->spacing, x->reach, pool, e);
}

/* Where slabs end that have about the same number of points; returns the axis they are across. */
static int cut_slabs(const quality_input *in, size_t slabs, double *end)
{
    bbox box = bbox_empty();
    for (size_t i = 0; i < in->count; i++) box = bbox_include(box, in->position[i]);
    vec3 size = vec3_sub(box.max, box.min);
    int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    double low = vec3_get(box.min, axis), width = vec3_get(size, axis) / BINS;
    size_t bin[BINS] = {0}, k = 0, seen = 0;
    for (size_t i = 0; slabs > 1 && width > 0 && i < in->count; i++) {
        double at = (vec3_get(in->position[i], axis) - low) / width;
        bin[at < BINS ? (size_t)at : BINS - 1]++;
    }
    for (size_t b = 0; b < BINS; b++) {
        seen += bin[b];
        while (k + 1 < slabs && seen * slabs >= (k + 1) * in->count) end[k++] = low + (double)(b + 1) * width;
    }
    while (k < slabs) end[k++] = INFINITY;
    return axis;
}

bool quality_measure(const quality_input *in, threads *pool, double *spacing_local, uint8_t *degree,
                     quality *out, error *e)
{
    size_t slabs = in->count / SLAB_POINTS < SLABS_MOST ? in->count / SLAB_POINTS + 1 : SLABS_MOST;
    double *end = mem_array(slabs, sizeof *end, "the quality measures", e), low = -INFINITY;
    if (!end) return false;
    bool ok = true;
    const extent x = extent_of(in);
    int axis = cut_slabs(in, slabs, end);
    tally whole = tally_empty();
    for (size_t k = 0; k < slabs && ok; low = end[k++]) {
        if (!(low < end[k])) continue; /* so many points in one bin that it is the last of two slabs */
        slab s = {.axis = axis, .low = low, .high = end[k], .graded = x.coarsest > EVEN_REQUEST * x.finest};
        ok = fill_slab(in, &x, pool, &s, e);
        measure_job job = {&s, &s.in, {s.position, s.normal, s.spacing, s.near}, spacing_local, degree};
        if (ok) threads_run(pool, s.in.count, CHUNK, mark_chunk, &job);
        if (ok) threads_run(pool, s.in.count, CHUNK, tally_chunk, &job);
        for (size_t c = 0; ok && c < (s.in.count + CHUNK - 1) / CHUNK; c++) add_tally(&whole, &s.tally[c]);
        free_slab(&s);
    }
    free(end);
    if (ok) *out = conclude(&whole);
    return ok;
}
