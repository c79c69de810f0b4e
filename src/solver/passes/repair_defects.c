/* mend: takes disorder out of a packing at rest, see solver_repair_defects.
 *
 * Descent moves particles, and makes none and takes none away. So a dislocation that would have to climb stays where it is:
 * its half row ends there. Here a small piece of the packing around it is tried with one particle less, one more, or one moved
 * to another place, and comes to rest each time with all around held fast, other sheets included; the piece that costs least
 * replaces it: that has few particles with other than six neighbours, cells of even size, and little strain. At first it may
 * also cost a little more than what was there. Pieces do not touch each other, so that they are tried side by side, and what
 * one gains another gives: the count stays. */
#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "packing/neighbours.h"
#include "packing/packing.h"
#include "voronoi/voronoi.h"
#include "solver/passes/repair_region.h"

/* Of a piece, in spacings of its middle: who moves, who is judged, and who is seen. Smaller pieces come into an order that
 * does not last once all may move. */
static const double FREE_RADIUS = 3.8, JUDGED_RADIUS = 4.4, SEEN_RADIUS = 6.0;
/* A piece in which fewer move, as of a small patch, has no order to mend, and would give its points away. */
enum { FREE_LEAST = 8 };
/* Pieces that are tried together, which bounds memory; and how often one is tried at a time, in chains that begin anew. */
enum { PIECES_MOST = 256, TRIES = 16, CHAIN = 8, QUEUE_MOST = 1024 };
/* A chain goes on from what costs up to so much more. A piece may stay so much worse, too: ever less over this share of the
 * passes, so that dislocations which no try brings together wander until they meet. */
static const double HEAT = 1, WARMTH = 1, WARM_SHARE = 0.7;
/* Passes over all pieces for so many particles of which no more than so many were out of order, more by the square where more were,
 * up to PASSES_MOST; and how many of them before all may move. */
static const double PASSES = 72, PASSES_COUNT = 1e4, PASSES_SHARE = 0.14, PASSES_MOST = 240;
/* On patches: a pass takes longer beside the solve, and the first of them bring most. */
static const double PASSES_ON_PATCHES = 12;
enum { PASSES_AT_ONCE = 2 };
/* Below this share of particles with other than six neighbours there is nothing to mend. */
static const double ORDERED_SHARE = 0.05;
/* After that: the amplitude of a particle falls with so many powers of how much too wide its cell is. A spacing goes as alpha^0.18
 * where all have it, and a pair has half of it from each; more costs more order than it evens out. A cell that is farther off
 * is not of one sheet. */
static const double EVENING = 3, CELL_OFF = 0.15;
/* That is done again while the others' spacings vary by more than this, over the mean, and so often at most. */
static const double EVEN_CELLS = 0.02;
enum { EVENINGS = 3 };
/* What is worth a change. */
static const double LEAST_GAIN = 1e-3;

/* By how many particles a piece has become more: -1, 0 or 1. */
enum { CHANGES = 3 };

typedef struct outcome {
    bool found;
    double gain;      /* over the piece as it was; while there is none, the least that counts */
    vec3 *x, *normal; /* REPAIR_FREE_MOST */
} outcome;

/* What a piece is made of, and what came of it. */
typedef struct site {
    uint32_t start; /* its middle */
    uint32_t count, own, free;
    uint32_t *
        member; /* REPAIR_REGION_MOST; those that move first, and those of other sheets, from `own` on, last */
    outcome outcome[CHANGES];
    int chosen;
} site;

typedef struct mending {
    solver *s;
    int pass;
    double warmth; /* of this pass */
    neighbours *near;
    double *h;
    double *local;           /* of each particle: the spacing that its cell has, over h; 0: it has none */
    double mean;             /* of these */
    uint8_t *degree, *taken; /* of each particle; TAKEN_... */
    uint32_t *order;         /* particles with other than six neighbours */
    size_t disordered;
    uint32_t *seen; /* by which piece it was seen last */
    uint32_t stamp;
    site *site; /* PIECES_MOST */
    size_t sites;
    uint32_t *members;     /* of all sites */
    vec3 *places;          /* of all outcomes */
    repair_scratch *bench; /* one for each worker */
} mending;

enum { TAKEN_NOT, TAKEN_SEEN, TAKEN_MOVES };

static void keep(outcome *o, double gain, const repair_region *p)
{
    o->found = true;
    o->gain = gain;
    memcpy(o->x, p->x, p->free * sizeof *p->x);
    memcpy(o->normal, p->normal, p->free * sizeof *p->normal);
}

/* --- all pieces --- */

static bool is_within(const mending *m, uint32_t i, uint32_t middle, double radius)
{
    const vec3 *x = m->s->state.p->position;
    const double reach = radius * m->h[middle];
    return vec3_norm2(vec3_sub(x[i], x[middle])) < reach * reach;
}

static bool may_move(const mending *m, uint32_t i, uint32_t middle)
{
    return is_within(m, i, middle, FREE_RADIUS) && !particles_is_fixed(m->s->state.p, i);
}

/* Who is around the site's middle on its own sheet: without a step to who faces away. How many. */
static uint32_t gather_sheet(mending *m, uint32_t middle, uint32_t queue[QUEUE_MOST])
{
    const vec3 *normal = m->s->state.p->normal;
    uint32_t count = 1;
    queue[0] = middle;
    m->seen[middle] = ++m->stamp;
    for (uint32_t head = 0; head < count; head++) {
        const uint32_t *list = neighbours_list(m->near, queue[head]);
        for (uint32_t k = 0; k < m->near->list_count[queue[head]] && count < QUEUE_MOST; k++) {
            const uint32_t j = list[k];
            if (m->seen[j] == m->stamp || vec3_dot(normal[queue[head]], normal[j]) < 0 ||
                !is_within(m, j, middle, SEEN_RADIUS))
                continue;
            m->seen[j] = m->stamp;
            queue[count++] = j;
        }
    }
    return count;
}

/* Who is near those that are judged, on other sheets: they push, and are held. False where they are too many. */
static bool gather_others(mending *m, site *out)
{
    for (uint32_t q = 0; q < out->own; q++) {
        if (!is_within(m, out->member[q], out->start, JUDGED_RADIUS)) continue;
        const uint32_t *list = neighbours_list(m->near, out->member[q]);
        for (uint32_t k = 0; k < m->near->list_count[out->member[q]]; k++) {
            if (m->seen[list[k]] == m->stamp) continue;
            if (out->count == REPAIR_REGION_MOST - 1) return false;
            m->seen[list[k]] = m->stamp;
            out->member[out->count++] = list[k];
        }
    }
    return true;
}

/* Who is around the site's middle. False where they are too many. */
static bool gather(mending *m, site *out)
{
    uint32_t queue[QUEUE_MOST];
    const uint32_t count = gather_sheet(m, out->start, queue);
    if (count > REPAIR_REGION_MOST - 1) return false;
    out->free = 0;
    for (uint32_t q = 0; q < count; q++)
        if (may_move(m, queue[q], out->start)) out->member[out->free++] = queue[q];
    out->count = out->free;
    for (uint32_t q = 0; q < count; q++)
        if (!may_move(m, queue[q], out->start)) out->member[out->count++] = queue[q];
    out->own = out->count;
    return out->free >= FREE_LEAST && out->free < REPAIR_FREE_MOST && gather_others(m, out);
}

/* Beside a face that cuts the surface; rows of curves stay where they are, and hold who is beside them. */
static bool is_at_end(const particles *p, uint32_t i)
{
    return !p->patch && p->near_boundary[i];
}

/* False where it touches another. */
static bool claim(mending *m, const site *t)
{
    for (uint32_t k = 0; k < t->count; k++) {
        uint8_t by = m->taken[t->member[k]];
        if (by == TAKEN_MOVES || (k < t->free && (by || is_at_end(m->s->state.p, t->member[k]))))
            return false;
    }
    for (uint32_t k = 0; k < t->count; k++) m->taken[t->member[k]] = k < t->free ? TAKEN_MOVES : TAKEN_SEEN;
    return true;
}

static void fill(const mending *m, const site *t, repair_region *out)
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
        out->awake[k] = false;
        out->hint[k] = p->hint ? p->hint[i] : FIELD_NO_HINT;
        out->judged[k] = k < t->own && is_within(m, i, t->start, JUDGED_RADIUS) && !particles_is_fixed(p, i);
    }
    repair_region_list(out);
}

/* Goes on from what came of a try where that costs little more. */
static void try_once(repair_scratch *b, site *t, rng *r)
{
    repair_region *tried = &b->tried;
    *tried = b->current;
    if (!repair_region_change(tried, r)) return;
    const int more = (int)tried->free - (int)b->as_is.free;
    if (abs(more) > 1) return;
    if (!repair_region_settle(b, tried)) return;
    if (repair_region_guess(tried) > repair_region_guess(&b->current)) return;
    outcome *o = &t->outcome[1 + more];
    const double base = b->as_is.cost, next = b->current.cost + HEAT * rng_uniform(r);
    if (!repair_region_judge(b, tried, fmax(next, base - o->gain - LEAST_GAIN))) return;
    const double gain = base - tried->cost;
    if (gain > o->gain + LEAST_GAIN && fabs(gain) > LEAST_GAIN) keep(o, gain, tried);
    if (tried->cost <= next) b->current = *tried;
}

static void try_chunk(void *context, int worker, size_t begin, size_t end)
{
    const mending *m = context;
    repair_scratch *b = &m->bench[worker];
    for (size_t q = begin; q < end; q++) {
        site *t = &m->site[q];
        rng r =
            rng_seed(m->s->setup.params.seed, RANDOM_STREAM_MENDING + ((uint64_t)m->pass << 32) + t->start);
        for (int k = 0; k < CHANGES; k++) {
            t->outcome[k].found = false;
            t->outcome[k].gain = -m->warmth * rng_uniform(&r);
        }
        fill(m, t, &b->as_is);
        b->mean = m->mean;
        repair_region_judge(b, &b->as_is, INFINITY);
        for (int k = 0; k < TRIES && b->as_is.disordered > 0; k++) {
            if (k % CHAIN == 0) b->current = b->as_is;
            try_once(b, t, &r);
        }
    }
}

/* What the site loses where its number of particles stays as it was. */
static double gain_by_count(const site *t)
{
    const outcome *same = &t->outcome[1];
    return t->outcome[t->chosen].gain - (same->found ? same->gain : 0);
}

/* Of each site the best that came of it, and where one gains a particle another loses one. */
static void choose(mending *m)
{
    int balance = 0;
    for (size_t q = 0; q < m->sites; q++) {
        const outcome *o = m->site[q].outcome;
        int best = 1;
        for (int k = 0; k < CHANGES; k++)
            if (o[k].found && (!o[best].found || o[k].gain > o[best].gain)) best = k;
        m->site[q].chosen = best;
        balance += best - 1;
    }
    while (balance != 0) {
        int sign = balance > 0 ? 1 : -1;
        site *least = NULL;
        for (size_t q = 0; q < m->sites; q++) {
            site *t = &m->site[q];
            if (t->chosen - 1 == sign && (!least || gain_by_count(t) < gain_by_count(least))) least = t;
        }
        assert(least);
        least->chosen = 1;
        balance -= sign;
    }
}

static void put(particles *p, uint32_t i, vec3 x, vec3 normal)
{
    p->position[i] = x;
    p->normal[i] = normal;
    p->lambda[i] = 0;
    if (p->hint) p->hint[i] = FIELD_NO_HINT;
}

/* How much is gained. Sets *changed where any piece was. */
static double apply(mending *m, bool *changed)
{
    particles *p = m->s->state.p;
    uint32_t spare[PIECES_MOST], spares = 0, wanting[PIECES_MOST], wants = 0;
    double gain = 0;
    for (size_t q = 0; q < m->sites; q++) {
        const site *t = &m->site[q];
        const outcome *o = &t->outcome[t->chosen];
        if (!o->found) continue;
        *changed = true;
        gain += o->gain;
        uint32_t stay = t->free - (t->chosen == 0);
        for (uint32_t k = 0; k < stay; k++) put(p, t->member[k], o->x[k], o->normal[k]);
        if (t->chosen == 0) spare[spares++] = t->member[stay];
        if (t->chosen == 2) wanting[wants++] = (uint32_t)q;
    }
    assert(spares == wants);
    for (uint32_t k = 0; k < wants; k++) {
        const site *t = &m->site[wanting[k]];
        if (p->patch) p->patch[spare[k]] = p->patch[t->start];
        put(p, spare[k], t->outcome[2].x[t->free], t->outcome[2].normal[t->free]);
    }
    return gain;
}

static void degree_chunk(void *context, int worker, size_t begin, size_t end)
{
    mending *m = context;
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

static double mean_local(const mending *m)
{
    double sum = 0, found = 0;
    for (size_t i = 0; i < m->s->state.p->count; i++) {
        const bool counts = m->local[i] > 0 && !particles_is_fixed(m->s->state.p, i);
        sum += counts ? m->local[i] : 0;
        found += counts;
    }
    return found > 0 ? sum / found : 1;
}

/* The particles with other than six neighbours, in a random order. */
static void find_disorder(mending *m)
{
    rng r = rng_seed(m->s->setup.params.seed, RANDOM_STREAM_MENDING + (uint64_t)m->pass);
    threads_run(m->s->setup.pool, m->s->state.p->count, 256, degree_chunk, m);
    m->mean = mean_local(m);
    m->disordered = 0;
    for (uint32_t i = 0; i < m->s->state.p->count; i++) {
        if (m->degree[i] == 6 || particles_is_fixed(m->s->state.p, i) ||
            particles_is_one_sided(m->s->state.p, i))
            continue;
        size_t to = (size_t)(rng_uniform(&r) * (double)(m->disordered + 1));
        m->order[m->disordered] = m->order[to];
        m->order[to] = i;
        m->disordered++;
    }
}

static bool find_near(mending *m, error *e)
{
    solver *s = m->s;
    const size_t n = s->state.p->count;
    solver_renew_sizes(s);
    for (size_t i = 0; i < n; i++) m->h[i] = s->state.spacing * particles_size(s->state.p, i);
    m->near->label = s->state.p->patch;
    return neighbours_build(m->near, n, s->state.p->position, s->state.p->size,
                            VORONOI_REACH * s->state.spacing, s->setup.pool, e);
}

static bool is_in_order(const mending *m)
{
    return (double)m->disordered < ORDERED_SHARE * (double)m->s->state.p->count;
}

static bool mend_once(mending *m, double *gain, bool *changed, error *e)
{
    solver *s = m->s;
    const size_t n = s->state.p->count;
    if (!find_near(m, e)) return false;
    find_disorder(m);
    if (is_in_order(m)) return true;
    memset(m->taken, TAKEN_NOT, n);
    memset(m->seen, 0, n * sizeof *m->seen);
    m->stamp = 0;
    *gain = 0;
    for (size_t next = 0; next < m->disordered && !threads_stopped(s->setup.pool);) {
        for (m->sites = 0; next < m->disordered && m->sites < PIECES_MOST; next++) {
            site *t = &m->site[m->sites];
            t->start = m->order[next];
            m->sites += !m->taken[t->start] && gather(m, t) && claim(m, t);
        }
        const bool narrow =
            threads_narrow(s->setup.pool, false); /* a piece is long work, however few particles there are */
        threads_run(s->setup.pool, m->sites, 1, try_chunk, m);
        threads_narrow(s->setup.pool, narrow);
        choose(m);
        *gain += apply(m, changed);
    }
    return !threads_stopped(s->setup.pool) || error_set(e, ERROR_CANCELLED, "stopped");
}

static bool begin(mending *m, solver *s, error *e)
{
    const char *what = "mending";
    const size_t n = s->state.p->count, workers = (size_t)threads_count(s->setup.pool);
    *m = (mending){.s = s};
    m->near = neighbours_new(n, s->setup.params.list_limit, e);
    m->h = mem_array(n, sizeof *m->h, what, e);
    m->local = mem_array(n, sizeof *m->local, what, e);
    m->degree = mem_array(n, sizeof *m->degree, what, e);
    m->taken = mem_array(n, sizeof *m->taken, what, e);
    m->order = mem_array(n, sizeof *m->order, what, e);
    m->seen = mem_array(n, sizeof *m->seen, what, e);
    m->site = mem_array(PIECES_MOST, sizeof *m->site, what, e);
    m->members = mem_array((size_t)PIECES_MOST * REPAIR_REGION_MOST, sizeof *m->members, what, e);
    m->places = mem_array((size_t)PIECES_MOST * CHANGES * 2 * REPAIR_FREE_MOST, sizeof *m->places, what, e);
    m->bench = mem_array(workers, sizeof *m->bench, what, e);
    if (!m->near || !m->h || !m->local || !m->degree || !m->taken || !m->order || !m->seen || !m->site ||
        !m->members || !m->places || !m->bench)
        return false;
    for (size_t q = 0; q < workers; q++) repair_scratch_begin(&m->bench[q], s);
    for (size_t q = 0; q < PIECES_MOST; q++) {
        m->site[q].member = m->members + q * REPAIR_REGION_MOST;
        for (int k = 0; k < CHANGES; k++) {
            m->site[q].outcome[k].x = m->places + (q * CHANGES + (size_t)k) * 2 * REPAIR_FREE_MOST;
            m->site[q].outcome[k].normal = m->site[q].outcome[k].x + REPAIR_FREE_MOST;
        }
    }
    return true;
}

static void end(mending *m)
{
    neighbours_free(m->near);
    free(m->h);
    free(m->local);
    free(m->degree);
    free(m->taken);
    free(m->order);
    free(m->seen);
    free(m->site);
    free(m->members);
    free(m->places);
    free(m->bench);
}

/* --- even cells --- */

/* Cells as they are. Returns how much the spacings that they have vary. */
static double measure_cells(mending *m)
{
    double squares = 0, found = 0;
    threads_run(m->s->setup.pool, m->s->state.p->count, 256, degree_chunk, m);
    m->mean = mean_local(m);
    for (size_t i = 0; i < m->s->state.p->count; i++) {
        const double off = m->local[i] / m->mean - 1;
        if (fabs(off) >= CELL_OFF) continue;
        squares += off * off;
        found++;
    }
    return found > 0 ? sqrt(squares / found) : 0;
}

/* Whose cell is too wide gets a smaller amplitude, those around come nearer, and so on. */
static void even_out(const mending *m)
{
    particles *p = m->s->state.p;
    for (size_t i = 0; i < p->count; i++) {
        const double off = m->local[i] / m->mean;
        if (fabs(off - 1) < CELL_OFF) p->alpha[i] *= pow(off, -EVENING);
    }
}

/* Particles get amplitudes, and what moves them knows these. */
static bool begin_evening(solver *s, error *e)
{
    if (s->state.equalisations++ > 0) return true;
    relax_free(s->scratch.relax);
    s->scratch.relax = solver_new_relax(s, s->scratch.capacity, e);
    return s->scratch.relax && particles_add_amplitudes(s->state.p, e);
}

bool solver_equalise_cells(solver *s, bool *changed, error *e)
{
    mending m = {.s = s};
    *changed = false;
    if (s->state.repairs == 0 || s->state.equalisations == EVENINGS) return true;
    bool ok = begin(&m, s, e) && find_near(&m, e);
    if (ok && (measure_cells(&m) > EVEN_CELLS || s->state.equalisations == 0)) {
        ok = *changed = begin_evening(s, e);
        if (ok) even_out(&m);
    }
    end(&m);
    return ok;
}

/* What the last level was found to have, sweeps ago; 0 where nobody looked. */
static bool was_in_order(const solver *s)
{
    return s->state.defect_fraction > 0 && s->state.defect_fraction < 0.5 * ORDERED_SHARE;
}

bool solver_repair_defects(solver *s, bool *changed, error *e)
{
    const double base = s->state.p->patch ? PASSES_ON_PATCHES : PASSES,
                 more = fmax(1, pow(s->state.defect_fraction / PASSES_SHARE, 2)),
                 passes = floor(fmin(base * more, PASSES_MOST) *
                                fmin(1, PASSES_COUNT / (double)s->state.p->count));
    mending m;
    bool ok = true, goes_on = s->state.equalisations == 0 && s->state.repairs < passes;
    *changed = false;
    if (!goes_on || (s->state.p->patch && was_in_order(s))) return true;
    ok = begin(&m, s, e);
    for (int k = 0; ok && goes_on && k < PASSES_AT_ONCE; k++) {
        double gain = 0;
        m.pass = s->state.repairs + 1;
        m.warmth = WARMTH * fmax(0, 1 - m.pass / (WARM_SHARE * passes));
        ok = mend_once(&m, &gain, changed, e);
        if (s->state.p->patch && is_in_order(&m)) break; /* of graded ones cells are evened out even so */
        s->state.repairs = m.pass;
        goes_on = (gain > 0 || m.warmth > 0) && s->state.repairs < passes;
    }
    end(&m);
    return ok;
}
