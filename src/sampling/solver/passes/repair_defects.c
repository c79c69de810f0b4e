// SPDX-License-Identifier: Apache-2.0
/* repair_defects: removes defects from a converged packing (solver_repair_defects).
 *
 * The descent neither inserts nor deletes particles. Therefore a dislocation cannot climb: a lattice row ends
 * there. Defect repair tries changes in a small region around each defect: one particle less, one more, or
 * one moved. Each trial is relaxed while the surrounding particles and those of opposite walls are fixed. The
 * trial of least cost replaces the region. Its cost counts defects, uneven cell areas and strain. Simulated
 * annealing: at first, a trial may cost slightly more than the region it replaces.
 *
 * Regions do not touch each other, so that they are tried in parallel. A particle that one region loses
 * another one gains: the count is constant. */
#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "sampling/packing/neighbours.h"
#include "geometry/space/packing.h"
#include "sampling/voronoi/voronoi.h"
#include "sampling/solver/passes/repair_region.h"

/* Radii of a region in spacings of its centre: particles that may move, particles that count for the cost,
 * and all members. Smaller regions reach an order that does not persist once all particles move. */
static const double FREE_RADIUS = 3.8, EVALUATED_RADIUS = 4.4, MEMBER_RADIUS = 6.0;
/* Minimum number of free members. A smaller region, as on a small patch, has no lattice to repair and
 * would lose its points. */
enum { MIN_FREE = 8 };
/* Regions that are tried in one batch; bounds the memory. */
enum { MAX_REGIONS = 256 };
/* Trials per region and pass. */
enum { TRIALS = 16 };
/* Trials of a chain; the next chain starts from the original region. */
enum { CHAIN_LENGTH = 8 };
/* Capacity of the breadth-first search of a region. */
enum { MAX_QUEUE = 1024 };
/* Maximum increase of the cost (in defects) from which a chain continues. */
static const double CHAIN_TEMPERATURE = 1;
/* Maximum increase of the cost (in defects) of a region in the first pass. Decreases linearly. It lets
 * dislocations move until they meet and annihilate. */
static const double START_TEMPERATURE = 1;
/* Fraction of the passes after which the cost may not increase. */
static const double COOLING_SHARE = 0.7;
/* Number of passes of a solve with up to PASSES_COUNT particles and a defect fraction up to PASSES_SHARE.
 * Beyond these it is inversely proportional to the count and proportional to the square of the defect
 * fraction. */
static const double PASSES = 72, PASSES_COUNT = 1e4, PASSES_SHARE = 0.14;
/* Maximum number of passes for a defect fraction above PASSES_SHARE. */
static const double MAX_PASSES = 240;
/* PASSES of a surface with patches. Fewer, since a pass is expensive compared with the solve and the first
 * passes gain most. */
static const double PASSES_ON_PATCHES = 12;
/* Passes between two relaxations of all particles. */
enum { PASSES_PER_CALL = 2 };
/* No repair if the defect fraction is below this. */
static const double ORDERED_SHARE = 0.05;
/* Exponent of the amplitude over the relative spacing of a cell, negated. The spacing scales as alpha^0.18 if
 * all amplitudes change, and half of a pair's force follows from each. Larger: more defects. */
static const double AREA_EXPONENT = 3;
/* Relative deviation of the spacing beyond which a cell is ignored: it spans opposite walls. */
static const double MAX_DEVIATION = 0.15;
/* Equalisation is repeated while the relative standard deviation of the cell spacings exceeds this. */
static const double TARGET_DEVIATION = 0.02;
/* Maximum number of equalisations. */
enum { MAX_EQUALISATIONS = 3 };
/* Minimum decrease of the cost by an outcome, in defects: ignores rounding errors. */
static const double MIN_GAIN = 1e-3;

/* Outcomes of a region: one particle less, equally many, one more. */
enum { OUTCOMES = 3 };

typedef struct outcome {
    bool found;
    double gain;      /* decrease of the cost; if !found: the minimum that counts */
    vec3 *x, *normal; /* REPAIR_MAX_FREE */
} outcome;

typedef struct region {
    uint32_t start;   /* centre */
    uint32_t count;   /* members */
    uint32_t own;     /* members of its own part of the surface; from `own` on those of opposite walls */
    uint32_t free;    /* the first `free` members may move */
    uint32_t *member; /* particles; REPAIR_MAX_MEMBERS */
    outcome outcome[OUTCOMES];
    int chosen; /* outcome */
} region;

typedef struct repair {
    solver *s;
    int pass;
    double temperature; /* of this pass: maximum increase of a region's cost, in defects */
    neighbours *near;
    double *h;
    double *local;   /* per particle: spacing of its Voronoi cell over h; 0: it has no cell */
    double mean;     /* of `local` */
    uint8_t *degree; /* per particle: Voronoi neighbours */
    uint8_t *used;   /* per particle: USED_... */
    uint32_t *order; /* the defects, in random order */
    size_t defects;
    uint32_t *visited; /* per particle: stamp of the last search that visited it */
    uint32_t stamp;
    region *region; /* MAX_REGIONS */
    size_t regions;
    uint32_t *members;       /* of all regions */
    vec3 *places;            /* of all outcomes */
    repair_scratch *scratch; /* per worker thread */
} repair;

/* Use of a particle by the regions of a batch. */
enum { USED_NOT, USED_FIXED, USED_FREE };

static void store_outcome(outcome *o, double gain, const repair_region *p)
{
    o->found = true;
    o->gain = gain;
    memcpy(o->x, p->x, p->free * sizeof *p->x);
    memcpy(o->normal, p->normal, p->free * sizeof *p->normal);
}

/* --- regions --- */

static bool is_within(const repair *m, uint32_t i, uint32_t middle, double radius)
{
    const vec3 *x = m->s->state.p->position;
    const double reach = radius * m->h[middle];
    return vec3_norm2(vec3_sub(x[i], x[middle])) < reach * reach;
}

static bool may_move(const repair *m, uint32_t i, uint32_t middle)
{
    return is_within(m, i, middle, FREE_RADIUS) && !particles_is_fixed(m->s->state.p, i);
}

/* Breadth-first search from the centre within MEMBER_RADIUS, without steps between opposite normals. Returns
 * the number of particles in `queue`. */
static uint32_t gather_connected(repair *m, uint32_t middle, uint32_t queue[MAX_QUEUE])
{
    const vec3 *normal = m->s->state.p->normal;
    uint32_t count = 1;
    queue[0] = middle;
    m->visited[middle] = ++m->stamp;
    for (uint32_t head = 0; head < count; head++) {
        const uint32_t *list = neighbours_list(m->near, queue[head]);
        for (uint32_t k = 0; k < m->near->list_count[queue[head]] && count < MAX_QUEUE; k++) {
            const uint32_t j = list[k];
            if (m->visited[j] == m->stamp || vec3_dot(normal[queue[head]], normal[j]) < 0 ||
                !is_within(m, j, middle, MEMBER_RADIUS))
                continue;
            m->visited[j] = m->stamp;
            queue[count++] = j;
        }
    }
    return count;
}

/* Appends the neighbours of the evaluated members on opposite walls: fixed members that contribute to the
 * forces. False: too many. */
static bool gather_opposite(repair *m, region *out)
{
    for (uint32_t q = 0; q < out->own; q++) {
        if (!is_within(m, out->member[q], out->start, EVALUATED_RADIUS)) continue;
        const uint32_t *list = neighbours_list(m->near, out->member[q]);
        for (uint32_t k = 0; k < m->near->list_count[out->member[q]]; k++) {
            if (m->visited[list[k]] == m->stamp) continue;
            if (out->count == REPAIR_MAX_MEMBERS - 1) return false;
            m->visited[list[k]] = m->stamp;
            out->member[out->count++] = list[k];
        }
    }
    return true;
}

/* Collects the members of the region around out->start. False: too many members, or too few free ones. */
static bool gather_region(repair *m, region *out)
{
    uint32_t queue[MAX_QUEUE];
    const uint32_t count = gather_connected(m, out->start, queue);
    if (count > REPAIR_MAX_MEMBERS - 1) return false;
    out->free = 0;
    for (uint32_t q = 0; q < count; q++)
        if (may_move(m, queue[q], out->start)) out->member[out->free++] = queue[q];
    out->count = out->free;
    for (uint32_t q = 0; q < count; q++)
        if (!may_move(m, queue[q], out->start)) out->member[out->count++] = queue[q];
    out->own = out->count;
    return out->free >= MIN_FREE && out->free < REPAIR_MAX_FREE && gather_opposite(m, out);
}

/* Whether a particle is near the boundary of an open surface. (Curve samples are fixed and hold the
 * particles beside them.) */
static bool is_near_boundary(const particles *p, uint32_t i)
{
    return !p->patch && p->near_boundary[i];
}

/* Marks the members as used by the region. False: it touches another region or the boundary. */
static bool claim(repair *m, const region *t)
{
    for (uint32_t k = 0; k < t->count; k++) {
        uint8_t by = m->used[t->member[k]];
        if (by == USED_FREE || (k < t->free && (by || is_near_boundary(m->s->state.p, t->member[k]))))
            return false;
    }
    for (uint32_t k = 0; k < t->count; k++) m->used[t->member[k]] = k < t->free ? USED_FREE : USED_FIXED;
    return true;
}

/* Copies the particles of a region to *out and builds its lists. */
static void load_region(const repair *m, const region *t, repair_region *out)
{
    const particles *p = m->s->state.p;
    out->count = t->count;
    out->free = t->free;
    out->field = particles_field(p, m->s->setup.field, t->start);
    for (uint32_t k = 0; k < t->count; k++) {
        uint32_t i = t->member[k];
        out->x[k] = p->position[i];
        out->normal[k] = p->normal[i];
        out->h[k] = m->h[i];
        out->active[k] = false;
        out->hint[k] = p->hint ? p->hint[i] : FIELD_NO_HINT;
        out->evaluated[k] =
            k < t->own && is_within(m, i, t->start, EVALUATED_RADIUS) && !particles_is_fixed(p, i);
    }
    repair_region_list(out);
}

/* One trial change of b->current. If its cost permits, the chain continues from the result. */
static void try_once(repair_scratch *b, region *t, rng *r)
{
    repair_region *tried = &b->tried;
    *tried = b->current;
    if (!repair_region_modify(tried, r)) return;
    const int more = (int)tried->free - (int)b->as_is.free;
    if (abs(more) > 1) return;
    if (!repair_region_relax(b, tried)) return;
    if (repair_region_estimate_defects(tried) > repair_region_estimate_defects(&b->current)) return;
    outcome *o = &t->outcome[1 + more];
    const double base = b->as_is.cost, next = b->current.cost + CHAIN_TEMPERATURE * rng_uniform(r);
    if (!repair_region_evaluate(b, tried, fmax(next, base - o->gain - MIN_GAIN))) return;
    const double gain = base - tried->cost;
    if (gain > o->gain + MIN_GAIN && fabs(gain) > MIN_GAIN) store_outcome(o, gain, tried);
    if (tried->cost <= next) b->current = *tried;
}

static void try_chunk(void *context, int worker, size_t begin, size_t end)
{
    const repair *m = context;
    repair_scratch *b = &m->scratch[worker];
    for (size_t q = begin; q < end; q++) {
        region *t = &m->region[q];
        rng r =
            rng_seed(m->s->setup.params.seed, RANDOM_STREAM_REPAIR + ((uint64_t)m->pass << 32) + t->start);
        for (int k = 0; k < OUTCOMES; k++) {
            t->outcome[k].found = false;
            t->outcome[k].gain = -m->temperature * rng_uniform(&r);
        }
        load_region(m, t, &b->as_is);
        b->mean = m->mean;
        repair_region_evaluate(b, &b->as_is, INFINITY);
        for (int k = 0; k < TRIALS && b->as_is.defects > 0; k++) {
            if (k % CHAIN_LENGTH == 0) b->current = b->as_is;
            try_once(b, t, &r);
        }
    }
}

/* Loss of gain if the region keeps its number of particles. */
static double gain_by_count(const region *t)
{
    const outcome *same = &t->outcome[1];
    return t->outcome[t->chosen].gain - (same->found ? same->gain : 0);
}

/* Chooses the best outcome of each region. To keep the count, regions with the least loss of gain keep
 * their number of particles. */
static void choose_outcomes(repair *m)
{
    int balance = 0;
    for (size_t q = 0; q < m->regions; q++) {
        const outcome *o = m->region[q].outcome;
        int best = 1;
        for (int k = 0; k < OUTCOMES; k++)
            if (o[k].found && (!o[best].found || o[k].gain > o[best].gain)) best = k;
        m->region[q].chosen = best;
        balance += best - 1;
    }
    while (balance != 0) {
        int sign = balance > 0 ? 1 : -1;
        region *least = NULL;
        for (size_t q = 0; q < m->regions; q++) {
            region *t = &m->region[q];
            if (t->chosen - 1 == sign && (!least || gain_by_count(t) < gain_by_count(least))) least = t;
        }
        assert(least);
        least->chosen = 1;
        balance -= sign;
    }
}

static void place_particle(particles *p, uint32_t i, vec3 x, vec3 normal)
{
    p->position[i] = x;
    p->normal[i] = normal;
    p->lambda[i] = 0;
    if (p->hint) p->hint[i] = FIELD_NO_HINT;
}

/* Applies the chosen outcomes. Returns the total gain. Sets *changed if a region changed. */
static double apply_outcomes(repair *m, bool *changed)
{
    particles *p = m->s->state.p;
    uint32_t spare[MAX_REGIONS], spare_count = 0, gaining[MAX_REGIONS], gainers = 0;
    double gain = 0;
    for (size_t q = 0; q < m->regions; q++) {
        const region *t = &m->region[q];
        const outcome *o = &t->outcome[t->chosen];
        if (!o->found) continue;
        *changed = true;
        gain += o->gain;
        uint32_t stay = t->free - (t->chosen == 0);
        for (uint32_t k = 0; k < stay; k++) place_particle(p, t->member[k], o->x[k], o->normal[k]);
        if (t->chosen == 0) spare[spare_count++] = t->member[stay];
        if (t->chosen == 2) gaining[gainers++] = (uint32_t)q;
    }
    assert(spare_count == gainers);
    for (uint32_t k = 0; k < gainers; k++) {
        const region *t = &m->region[gaining[k]];
        if (p->patch) p->patch[spare[k]] = p->patch[t->start];
        place_particle(p, spare[k], t->outcome[2].x[t->free], t->outcome[2].normal[t->free]);
    }
    return gain;
}

static void degree_chunk(void *context, int worker, size_t begin, size_t end)
{
    repair *m = context;
    const particles *p = m->s->state.p;
    const voronoi_sites sites = {p->position, p->normal, m->h, m->near, NULL, NULL};
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        voronoi_star star;
        voronoi_star_at(&sites, (uint32_t)i, &star);
        m->degree[i] = (uint8_t)(star.count < UINT8_MAX ? star.count : UINT8_MAX);
        m->local[i] = packing_spacing(fmax(voronoi_star_area(&star), 0), 1) / m->h[i];
    }
}

/* Mean of `local` over the free particles with a cell; 1 if there are none. */
static double mean_local(const repair *m)
{
    double sum = 0, found = 0;
    for (size_t i = 0; i < m->s->state.p->count; i++) {
        const bool counts = m->local[i] > 0 && !particles_is_fixed(m->s->state.p, i);
        sum += counts ? m->local[i] : 0;
        found += counts;
    }
    return found > 0 ? sum / found : 1;
}

/* Lists the free particles without six neighbours in random order. */
static void find_defects(repair *m)
{
    rng r = rng_seed(m->s->setup.params.seed, RANDOM_STREAM_REPAIR + (uint64_t)m->pass);
    threads_run(m->s->setup.pool, m->s->state.p->count, THREADS_GRAIN, degree_chunk, m);
    m->mean = mean_local(m);
    m->defects = 0;
    for (uint32_t i = 0; i < m->s->state.p->count; i++) {
        if (m->degree[i] == PACKING_IDEAL_DEGREE || particles_is_fixed(m->s->state.p, i) ||
            particles_is_one_sided(m->s->state.p, i))
            continue;
        size_t to = (size_t)(rng_uniform(&r) * (double)(m->defects + 1));
        m->order[m->defects] = m->order[to];
        m->order[to] = i;
        m->defects++;
    }
}

static bool build_lists(repair *m, error *e)
{
    solver *s = m->s;
    const size_t n = s->state.p->count;
    solver_renew_sizes(s);
    for (size_t i = 0; i < n; i++) m->h[i] = s->state.spacing * particles_size(s->state.p, i);
    m->near->label = s->state.p->patch;
    return neighbours_build(m->near, n, s->state.p->position, s->state.p->size,
                            VORONOI_REACH * s->state.spacing, s->setup.pool, e);
}

static bool is_ordered(const repair *m)
{
    return (double)m->defects < ORDERED_SHARE * (double)m->s->state.p->count;
}

static bool repair_once(repair *m, double *gain, bool *changed, error *e)
{
    solver *s = m->s;
    const size_t n = s->state.p->count;
    if (!build_lists(m, e)) return false;
    find_defects(m);
    if (is_ordered(m)) return true;
    memset(m->used, USED_NOT, n);
    memset(m->visited, 0, n * sizeof *m->visited);
    m->stamp = 0;
    *gain = 0;
    for (size_t next = 0; next < m->defects && !threads_stopped(s->setup.pool);) {
        for (m->regions = 0; next < m->defects && m->regions < MAX_REGIONS; next++) {
            region *t = &m->region[m->regions];
            t->start = m->order[next];
            m->regions += !m->used[t->start] && gather_region(m, t) && claim(m, t);
        }
        /* a region is a long task: all threads, even if there are few particles */
        const bool narrow = threads_narrow(s->setup.pool, false);
        threads_run(s->setup.pool, m->regions, 1, try_chunk, m);
        threads_narrow(s->setup.pool, narrow);
        choose_outcomes(m);
        *gain += apply_outcomes(m, changed);
    }
    return threads_may_go_on(s->setup.pool, e);
}

static bool begin(repair *m, solver *s, error *e)
{
    const char *what = "defect repair";
    const size_t n = s->state.p->count, workers = (size_t)threads_count(s->setup.pool);
    *m = (repair){.s = s};
    m->near = neighbours_new(n, s->setup.params.list_limit, e);
    m->h = mem_array(n, sizeof *m->h, what, e);
    m->local = mem_array(n, sizeof *m->local, what, e);
    m->degree = mem_array(n, sizeof *m->degree, what, e);
    m->used = mem_array(n, sizeof *m->used, what, e);
    m->order = mem_array(n, sizeof *m->order, what, e);
    m->visited = mem_array(n, sizeof *m->visited, what, e);
    m->region = mem_array(MAX_REGIONS, sizeof *m->region, what, e);
    m->members = mem_array((size_t)MAX_REGIONS * REPAIR_MAX_MEMBERS, sizeof *m->members, what, e);
    m->places = mem_array((size_t)MAX_REGIONS * OUTCOMES * 2 * REPAIR_MAX_FREE, sizeof *m->places, what, e);
    m->scratch = mem_array(workers, sizeof *m->scratch, what, e);
    if (!m->near || !m->h || !m->local || !m->degree || !m->used || !m->order || !m->visited || !m->region ||
        !m->members || !m->places || !m->scratch)
        return false;
    for (size_t q = 0; q < workers; q++) repair_scratch_init(&m->scratch[q], s);
    for (size_t q = 0; q < MAX_REGIONS; q++) {
        m->region[q].member = m->members + q * REPAIR_MAX_MEMBERS;
        for (int k = 0; k < OUTCOMES; k++) {
            m->region[q].outcome[k].x = m->places + (q * OUTCOMES + (size_t)k) * 2 * REPAIR_MAX_FREE;
            m->region[q].outcome[k].normal = m->region[q].outcome[k].x + REPAIR_MAX_FREE;
        }
    }
    return true;
}

static void end(repair *m)
{
    neighbours_free(m->near);
    free(m->h);
    free(m->local);
    free(m->degree);
    free(m->used);
    free(m->order);
    free(m->visited);
    free(m->region);
    free(m->members);
    free(m->places);
    free(m->scratch);
}

/* --- equalisation of cell areas --- */

/* Measures all cells. Returns the relative standard deviation of their spacings. */
static double measure_cells(repair *m)
{
    double squares = 0, found = 0;
    threads_run(m->s->setup.pool, m->s->state.p->count, THREADS_GRAIN, degree_chunk, m);
    m->mean = mean_local(m);
    for (size_t i = 0; i < m->s->state.p->count; i++) {
        const double deviation = m->local[i] / m->mean - 1;
        if (fabs(deviation) >= MAX_DEVIATION) continue;
        squares += deviation * deviation;
        found++;
    }
    return found > 0 ? sqrt(squares / found) : 0;
}

/* Decreases the amplitude of particles with large cells, so that their neighbours come nearer, and vice
 * versa. */
static void scale_amplitudes(const repair *m)
{
    particles *p = m->s->state.p;
    for (size_t i = 0; i < p->count; i++) {
        const double ratio = m->local[i] / m->mean;
        if (fabs(ratio - 1) < MAX_DEVIATION) p->alpha[i] *= elementary_pow(ratio, -AREA_EXPONENT);
    }
}

bool solver_equalise_cells(solver *s, bool *changed, error *e)
{
    repair m = {.s = s};
    if (s->state.repairs == 0 || s->state.equalisations == MAX_EQUALISATIONS) return true;
    bool ok = begin(&m, s, e) && build_lists(&m, e);
    if (ok && (measure_cells(&m) > TARGET_DEVIATION || s->state.equalisations == 0)) {
        s->state.equalisations++;
        ok = *changed = particles_add_amplitudes(s->state.p, e);
        if (ok) scale_amplitudes(&m);
    }
    end(&m);
    return ok;
}

/* Whether the last measurement of the defect fraction was low; 0: it was not measured. */
static bool was_ordered(const solver *s)
{
    return s->state.defect_fraction > 0 && s->state.defect_fraction < 0.5 * ORDERED_SHARE;
}

bool solver_repair_defects(solver *s, bool *changed, error *e)
{
    const double base = s->state.p->patch ? PASSES_ON_PATCHES : PASSES,
                 share = s->state.defect_fraction / PASSES_SHARE, more = fmax(1, share * share),
                 passes =
                     floor(fmin(base * more, MAX_PASSES) * fmin(1, PASSES_COUNT / (double)s->state.p->count));
    repair m;
    bool ok = true, goes_on = s->state.equalisations == 0 && s->state.repairs < passes;
    if (!goes_on || (s->state.p->patch && was_ordered(s))) return true;
    ok = begin(&m, s, e);
    for (int k = 0; ok && goes_on && k < PASSES_PER_CALL; k++) {
        double gain = 0;
        m.pass = s->state.repairs + 1;
        m.temperature = START_TEMPERATURE * fmax(0, 1 - m.pass / (COOLING_SHARE * passes));
        ok = repair_once(&m, &gain, changed, e);
        if (s->state.p->patch && is_ordered(&m))
            break; /* without patches, equalisation follows in any case */
        s->state.repairs = m.pass;
        goes_on = (gain > 0 || m.temperature > 0) && s->state.repairs < passes;
    }
    end(&m);
    return ok;
}
