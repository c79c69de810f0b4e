/* mend: takes disorder out of a packing at rest, see sampler_mend.
 *
 * Descent moves particles, and makes none and takes none away. So a dislocation that would have to climb stays where it is:
 * its half row ends there. Here a small piece of the packing around it is tried with one particle less, one more, or one moved
 * to another place, and comes to rest each time with all around held fast; the piece that has the fewest
 * particles with other than six neighbours replaces it. Pieces do not touch each other, so that they are tried side by side,
 * and what one gains another gives: the count stays. */
#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "packing/energy.h"
#include "packing/neighbours.h"
#include "packing/packing.h"
#include "packing/pair.h"
#include "packing/voronoi.h"
#include "particles/random_streams.h"
#include "sampler/sampler_internal.h"
#include "surface/projection.h"

/* Of a piece, in spacings of its middle: who moves, who is judged, and who is seen. Smaller pieces come into an order that
 * does not last once all may move. */
static const double FREE_RADIUS = 3.8, JUDGED_RADIUS = 4.4, SEEN_RADIUS = 6.0;
enum { PIECE_MOST = 256, LIST_MOST = 64 * PIECE_MOST, QUEUE_MOST = 1024 };
/* Pieces that are tried together, which bounds memory; and how often one is tried at a time. */
enum { PIECES_MOST = 256, TRIES = 8, SWEEPS = 16, LIST_SWEEPS = 8 };
/* Of the tries: one less; one more; the rest moves one. */
static const double REMOVAL = 0.4, INSERTION = 0.4;
/* Passes over all pieces for so many particles, and how many of them before all may move. */
static const double PASSES = 24, PASSES_COUNT = 1e4;
enum { PASSES_AT_ONCE = 2 };
/* Below this share of particles with other than six neighbours there is nothing to mend. */
static const double ORDERED_SHARE = 0.05;
/* An ideal energy of excess counts as so many particles out of order: of pieces with as many, the one under less strain
 * remains. And what is worth a change. */
static const double PRICE = 0.1, LEAST_GAIN = 1e-3;
/* A particle more in the same area adds so many ideal energies to the sum. */
static const double PRESSURE = 3.35;
/* Over-relaxation, and the longest step over h. */
static const double OMEGA = 2.4, LONGEST_STEP = 0.15;
/* Of lists: beyond the support; and between the first and the second shell. */
static const double LIST_REACH = 2.1, BETWEEN_SHELLS = 1.366;
/* Closer than this to another, over the support, nobody is pushed any harder. */
static const double CLOSEST = 0.05;

typedef struct piece {
    uint32_t count, free; /* the first `free` move */
    vec3 x[PIECE_MOST], normal[PIECE_MOST];
    double h[PIECE_MOST];
    bool judged[PIECE_MOST];
    uint8_t degree[PIECE_MOST]; /* of the judged, else 6 */
    uint32_t list[LIST_MOST], begin[PIECE_MOST], listed[PIECE_MOST];
    int disordered;
    double cost;
} piece;

/* By how many particles a piece has become more: -1, 0 or 1. */
enum { CHANGES = 3 };

typedef struct outcome {
    double gain;      /* over the piece as it was; 0: there is none */
    vec3 *x, *normal; /* PIECE_MOST */
} outcome;

/* What a piece is made of, and what came of it. */
typedef struct site {
    uint32_t start; /* its middle */
    uint32_t count, free;
    uint32_t *member; /* PIECE_MOST; those that move first */
    outcome outcome[CHANGES];
    int chosen;
} site;

typedef struct mending {
    sampler *s;
    int pass;
    neighbours *near;
    double *h;
    uint8_t *degree, *taken; /* of each particle; TAKEN_... */
    uint32_t *order;         /* particles with other than six neighbours */
    size_t disordered;
    uint32_t *seen; /* by which piece it was seen last */
    uint32_t stamp;
    site *site; /* PIECES_MOST */
    size_t sites;
    uint32_t *members; /* of all sites */
    vec3 *places;      /* of all outcomes */
    piece *scratch;    /* two for each worker */
} mending;

enum { TAKEN_NOT, TAKEN_SEEN, TAKEN_MOVES };

/* --- a piece --- */

static void make_lists(piece *p, double reach)
{
    uint32_t at = 0;
    for (uint32_t i = 0; i < p->count; i++) {
        p->begin[i] = at;
        for (uint32_t j = 0; j < p->count && at < LIST_MOST; j++) {
            double within = reach * 0.5 * (p->h[i] + p->h[j]);
            p->list[at] = j;
            at += j != i && vec3_norm2(vec3_sub(p->x[i], p->x[j])) < within * within;
        }
        p->listed[i] = at - p->begin[i];
    }
}

/* w cot w over w: the same bits everywhere. */
static double cotangent(double w)
{
    double sum = 0, square = w * w;
    for (int k = ENERGY_COT_TERMS - 1; k >= 0; k--) sum = sum * square + energy_cot_polynomial[k];
    return sum / w;
}

/* The energies of those that are judged, over the ideal, less what their number alone asks for. */
static double excess(const piece *p)
{
    double sum = 0;
    for (uint32_t i = 0; i < p->count; i++) {
        if (!p->judged[i]) continue;
        double energy = 0;
        for (uint32_t k = 0; k < p->listed[i]; k++) {
            uint32_t j = p->list[p->begin[i] + k];
            double size = 0.5 * (p->h[i] + p->h[j]);
            double u = vec3_norm(vec3_sub(p->x[i], p->x[j])) / packing_support(size),
                   w = fmax(u, CLOSEST) * M_PI_2;
            if (u < 1)
                energy += pair_facing(p->normal[i], p->normal[j]) * (cotangent(w) + w - M_PI_2) * size * size;
        }
        sum += energy / (p->h[i] * p->h[i] * energy_cotangent.ideal) - PRESSURE;
    }
    return sum;
}

static void judge(piece *p)
{
    make_lists(p, VORONOI_REACH);
    const neighbours near = {.count = p->count,
                             .list = p->list,
                             .list_begin = p->begin,
                             .list_count = p->listed,
                             .list_capacity = LIST_MOST};
    const voronoi_sites sites = {p->x, p->normal, p->h, &near, NULL, NULL};
    p->disordered = 0;
    for (uint32_t i = 0; i < p->count; i++) {
        voronoi_star star;
        p->degree[i] = 6;
        if (!p->judged[i]) continue;
        voronoi_star_at(&sites, i, &star);
        p->degree[i] = (uint8_t)(star.count < UINT8_MAX ? star.count : UINT8_MAX);
        p->disordered += star.count != 6;
    }
    p->cost = p->disordered + PRICE * excess(p);
}

/* How many are judged that have other than six neighbours between the shells: nearly as many as are disordered, and sooner
 * found. */
static int guess(piece *p)
{
    int found = 0;
    make_lists(p, BETWEEN_SHELLS);
    for (uint32_t i = 0; i < p->count; i++) found += p->judged[i] && p->listed[i] != 6;
    return found;
}

/* One Newton step, with the first term of (10) alone. */
static void move_particle(const sampler *s, piece *p, uint32_t i)
{
    vec3 u, v, x, normal = p->normal[i];
    double force_u = 0, force_v = 0, uu = 0, uv = 0, vv = 0;
    vec3_frame(normal, &u, &v);
    for (uint32_t k = 0; k < p->listed[i]; k++) {
        uint32_t j = p->list[p->begin[i] + k];
        vec3 d = vec3_sub(p->x[i], p->x[j]);
        double size = 0.5 * (p->h[i] + p->h[j]), support = packing_support(size), r2 = vec3_norm2(d);
        if (!(r2 < support * support) || !(r2 > 0)) continue;
        double r = sqrt(r2), c = cotangent(fmax(r / support, CLOSEST) * M_PI_2);
        double weight = pair_facing(p->normal[i], p->normal[j]) * size * size;
        double first = -M_PI_2 * weight * c * c / support;
        double second = 2 * M_PI_2 * M_PI_2 * weight * c * (1 + c * c) / (support * support);
        double a = vec3_dot(d, u) / r, b = vec3_dot(d, v) / r;
        force_u += first * a;
        force_v += first * b;
        uu += second * a * a;
        uv += second * a * b;
        vv += second * b * b;
    }
    double determinant = uu * vv - uv * uv;
    if (!(determinant > 1e-9 * (uu + vv) * (uu + vv))) return;
    double a = -OMEGA * (vv * force_u - uv * force_v) / determinant;
    double b = -OMEGA * (uu * force_v - uv * force_u) / determinant;
    double shorter = fmin(1, LONGEST_STEP * p->h[i] / fmax(sqrt(a * a + b * b), 1e-300));
    x = vec3_axpy(shorter * a, u, vec3_axpy(shorter * b, v, p->x[i]));
    const projection_limits limits = {6, 1e-3 * p->h[i], 3e-2 * p->h[i], 1e-2 * p->h[i]};
    if (!projection_find(s->setup.field, &limits, &x, &normal)) return;
    p->x[i] = x;
    p->normal[i] = normal;
}

static void renew_sizes(const sampler *s, piece *p)
{
    for (uint32_t i = 0; i < p->free; i++)
        p->h[i] = sizing_field_spacing(s->setup.params.sizing, p->x[i], NULL);
}

static void settle(const sampler *s, piece *p)
{
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        if (sweep % LIST_SWEEPS == 0) {
            if (sweep > 0) renew_sizes(s, p);
            make_lists(p, LIST_REACH);
        }
        for (uint32_t i = 0; i < p->free; i++) move_particle(s, p, i);
    }
    renew_sizes(s, p);
}

/* --- what is tried --- */

static vec3 random_tangent(vec3 normal, rng *r)
{
    vec3 u, v;
    double angle = 2 * M_PI * rng_uniform(r);
    vec3_frame(normal, &u, &v);
    return vec3_axpy(cos(angle), u, vec3_scale(v, sin(angle)));
}

static void copy_member(piece *p, uint32_t to, uint32_t from)
{
    p->x[to] = p->x[from];
    p->normal[to] = p->normal[from];
    p->h[to] = p->h[from];
    p->judged[to] = p->judged[from];
    p->degree[to] = p->degree[from];
}

static void take_out(piece *p, uint32_t k)
{
    assert(k < p->free);
    copy_member(p, k, --p->free);
    copy_member(p, p->free, --p->count);
}

/* Half a spacing from one that moves. */
static bool put_in(const sampler *s, piece *p, uint32_t beside, rng *r)
{
    const double h = p->h[beside];
    vec3 normal = p->normal[beside], x = vec3_axpy(0.5 * h, random_tangent(normal, r), p->x[beside]);
    if (p->count == PIECE_MOST || !sampler_land(s->setup.field, h, h, &x, &normal)) return false;
    copy_member(p, p->count++, p->free);
    p->x[p->free] = x;
    p->normal[p->free] = normal;
    p->h[p->free] = h;
    p->judged[p->free] = true;
    p->degree[p->free++] = 6;
    return true;
}

/* One of those that are out of order and move; false where there is none. */
static bool pick(const piece *p, rng *r, uint32_t *out)
{
    uint32_t found = 0;
    for (uint32_t k = 0; k < p->free; k++)
        if (p->degree[k] != 6 && rng_uniform(r) * ++found < 1) *out = k;
    return found > 0;
}

/* False where nothing was changed. */
static bool change(const sampler *s, piece *p, rng *r)
{
    uint32_t who = 0;
    const double kind = rng_uniform(r);
    if (!pick(p, r, &who)) return false;
    if (kind < INSERTION) return put_in(s, p, who, r);
    take_out(p, who);
    return kind < INSERTION + REMOVAL || (pick(p, r, &who) && put_in(s, p, who, r));
}

static void keep(outcome *o, double gain, const piece *p)
{
    o->gain = gain;
    memcpy(o->x, p->x, p->free * sizeof *p->x);
    memcpy(o->normal, p->normal, p->free * sizeof *p->normal);
}

/* --- all pieces --- */

/* Who is around the site's middle. False where they are too many, or where another sheet is so near that its particles push
 * these. */
static bool gather(mending *m, site *out)
{
    const particles *p = m->s->state.p;
    uint32_t queue[QUEUE_MOST], count = 1;
    double distance[QUEUE_MOST];
    queue[0] = out->start;
    distance[0] = 0;
    m->seen[out->start] = ++m->stamp;
    for (uint32_t head = 0; head < count; head++) {
        const uint32_t *list = neighbours_list(m->near, queue[head]);
        for (uint32_t k = 0; k < m->near->list_count[queue[head]] && count < QUEUE_MOST; k++) {
            uint32_t j = list[k];
            double away = vec3_norm(vec3_sub(p->position[j], p->position[out->start])) / m->h[out->start];
            if (m->seen[j] == m->stamp || !(away < SEEN_RADIUS)) continue;
            if (vec3_dot(p->normal[queue[head]], p->normal[j]) < 0) return false;
            m->seen[j] = m->stamp;
            queue[count] = j;
            distance[count++] = away;
        }
    }
    if (count > PIECE_MOST - 1) return false;
    out->count = out->free = 0;
    for (uint32_t q = 0; q < count; q++)
        if (distance[q] < FREE_RADIUS) out->member[out->free++] = queue[q];
    out->count = out->free;
    for (uint32_t q = 0; q < count; q++)
        if (!(distance[q] < FREE_RADIUS)) out->member[out->count++] = queue[q];
    return true;
}

/* False where it touches another. */
static bool claim(mending *m, const site *t)
{
    for (uint32_t k = 0; k < t->count; k++) {
        uint8_t by = m->taken[t->member[k]];
        if (by == TAKEN_MOVES || (k < t->free && (by || m->s->state.p->near_boundary[t->member[k]])))
            return false;
    }
    for (uint32_t k = 0; k < t->count; k++) m->taken[t->member[k]] = k < t->free ? TAKEN_MOVES : TAKEN_SEEN;
    return true;
}

static void fill(const mending *m, const site *t, piece *out)
{
    const particles *p = m->s->state.p;
    const vec3 middle = p->position[t->start];
    const double judged = JUDGED_RADIUS * m->h[t->start];
    out->count = t->count;
    out->free = t->free;
    for (uint32_t k = 0; k < t->count; k++) {
        uint32_t i = t->member[k];
        out->x[k] = p->position[i];
        out->normal[k] = p->normal[i];
        out->h[k] = m->h[i];
        out->judged[k] = vec3_norm2(vec3_sub(out->x[k], middle)) < judged * judged;
    }
}

static void try_chunk(void *context, int worker, size_t begin, size_t end)
{
    const mending *m = context;
    piece *as_is = &m->scratch[2 * worker], *tried = as_is + 1;
    for (size_t q = begin; q < end; q++) {
        site *t = &m->site[q];
        rng r =
            rng_seed(m->s->setup.params.seed, RANDOM_STREAM_MENDING + ((uint64_t)m->pass << 32) + t->start);
        for (int k = 0; k < CHANGES; k++) t->outcome[k].gain = 0;
        fill(m, t, as_is);
        judge(as_is);
        *tried = *as_is;
        const int guessed = guess(tried);
        for (int k = 0; k < TRIES && as_is->disordered > 0; k++) {
            *tried = *as_is;
            if (!change(m->s, tried, &r)) continue;
            settle(m->s, tried);
            if (guess(tried) > guessed) continue;
            judge(tried);
            outcome *o = &t->outcome[1 + (int)tried->free - (int)as_is->free];
            if (as_is->cost - tried->cost > o->gain + LEAST_GAIN) keep(o, as_is->cost - tried->cost, tried);
        }
    }
}

/* Of each site the best that came of it, and where one gains a particle another loses one. */
static void choose(mending *m)
{
    int balance = 0;
    for (size_t q = 0; q < m->sites; q++) {
        const outcome *o = m->site[q].outcome;
        int best = 1;
        for (int k = 0; k < CHANGES; k++)
            if (o[k].gain > o[best].gain) best = k;
        m->site[q].chosen = best;
        balance += best - 1;
    }
    while (balance != 0) {
        int sign = balance > 0 ? 1 : -1;
        site *least = NULL;
        for (size_t q = 0; q < m->sites; q++) {
            site *t = &m->site[q];
            if (t->chosen - 1 == sign &&
                (!least || t->outcome[t->chosen].gain - t->outcome[1].gain <
                               least->outcome[least->chosen].gain - least->outcome[1].gain))
                least = t;
        }
        assert(least);
        least->chosen = 1;
        balance -= sign;
    }
}

static double apply(mending *m)
{
    particles *p = m->s->state.p;
    uint32_t spare[PIECES_MOST], spares = 0, wanting[PIECES_MOST], wants = 0;
    double gain = 0;
    for (size_t q = 0; q < m->sites; q++) {
        const site *t = &m->site[q];
        const outcome *o = &t->outcome[t->chosen];
        if (!(o->gain > 0)) continue;
        gain += o->gain;
        uint32_t stay = t->free - (t->chosen == 0);
        for (uint32_t k = 0; k < stay; k++) {
            p->position[t->member[k]] = o->x[k];
            p->normal[t->member[k]] = o->normal[k];
            p->lambda[t->member[k]] = 0;
        }
        if (t->chosen == 0) spare[spares++] = t->member[stay];
        if (t->chosen == 2) wanting[wants++] = (uint32_t)q;
    }
    assert(spares == wants);
    for (uint32_t k = 0; k < wants; k++) {
        const site *t = &m->site[wanting[k]];
        p->position[spare[k]] = t->outcome[2].x[t->free];
        p->normal[spare[k]] = t->outcome[2].normal[t->free];
        p->lambda[spare[k]] = 0;
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
    }
}

/* The particles with other than six neighbours, in a random order. */
static void find_disorder(mending *m)
{
    rng r = rng_seed(m->s->setup.params.seed, RANDOM_STREAM_MENDING + (uint64_t)m->pass);
    threads_run(m->s->setup.pool, m->s->state.p->count, 256, degree_chunk, m);
    m->disordered = 0;
    for (uint32_t i = 0; i < m->s->state.p->count; i++) {
        if (m->degree[i] == 6) continue;
        size_t to = (size_t)(rng_uniform(&r) * (double)(m->disordered + 1));
        m->order[m->disordered] = m->order[to];
        m->order[to] = i;
        m->disordered++;
    }
}

static bool mend_once(mending *m, double *gain, error *e)
{
    sampler *s = m->s;
    const size_t n = s->state.p->count;
    sampler_resize(s);
    if (!neighbours_build(m->near, n, s->state.p->position, s->state.p->size,
                          VORONOI_REACH * s->state.spacing, s->setup.pool, e))
        return false;
    for (size_t i = 0; i < n; i++) m->h[i] = s->state.spacing * s->state.p->size[i];
    find_disorder(m);
    if ((double)m->disordered < ORDERED_SHARE * (double)n) return true;
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
        threads_run(s->setup.pool, m->sites, 1, try_chunk, m);
        choose(m);
        *gain += apply(m);
    }
    return !threads_stopped(s->setup.pool) || error_set(e, ERROR_CANCELLED, "stopped");
}

static bool begin(mending *m, sampler *s, error *e)
{
    const char *what = "mending";
    const size_t n = s->state.p->count, workers = (size_t)threads_count(s->setup.pool);
    *m = (mending){.s = s};
    m->near = neighbours_new(n, s->setup.params.list_limit, e);
    m->h = mem_array(n, sizeof *m->h, what, e);
    m->degree = mem_array(n, sizeof *m->degree, what, e);
    m->taken = mem_array(n, sizeof *m->taken, what, e);
    m->order = mem_array(n, sizeof *m->order, what, e);
    m->seen = mem_array(n, sizeof *m->seen, what, e);
    m->site = mem_array(PIECES_MOST, sizeof *m->site, what, e);
    m->members = mem_array((size_t)PIECES_MOST * PIECE_MOST, sizeof *m->members, what, e);
    m->places = mem_array((size_t)PIECES_MOST * CHANGES * 2 * PIECE_MOST, sizeof *m->places, what, e);
    m->scratch = mem_array(2 * workers, sizeof *m->scratch, what, e);
    if (!m->near || !m->h || !m->degree || !m->taken || !m->order || !m->seen || !m->site || !m->members ||
        !m->places || !m->scratch)
        return false;
    for (size_t q = 0; q < PIECES_MOST; q++) {
        m->site[q].member = m->members + q * PIECE_MOST;
        for (int k = 0; k < CHANGES; k++) {
            m->site[q].outcome[k].x = m->places + (q * CHANGES + (size_t)k) * 2 * PIECE_MOST;
            m->site[q].outcome[k].normal = m->site[q].outcome[k].x + PIECE_MOST;
        }
    }
    return true;
}

static void end(mending *m)
{
    neighbours_free(m->near);
    free(m->h);
    free(m->degree);
    free(m->taken);
    free(m->order);
    free(m->seen);
    free(m->site);
    free(m->members);
    free(m->places);
    free(m->scratch);
}

bool sampler_mend(sampler *s, bool *changed, error *e)
{
    const double passes = floor(PASSES * fmin(1, PASSES_COUNT / (double)s->state.p->count));
    mending m;
    bool ok = true, goes_on = s->state.mends < passes;
    *changed = false;
    if (!goes_on) return true;
    ok = begin(&m, s, e);
    for (int k = 0; ok && goes_on && k < PASSES_AT_ONCE; k++) {
        double gain = 0;
        m.pass = ++s->state.mends;
        ok = mend_once(&m, &gain, e);
        goes_on = gain > 0 && s->state.mends < passes;
        *changed |= gain > 0;
    }
    end(&m);
    return ok;
}
