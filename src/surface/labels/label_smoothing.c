// SPDX-License-Identifier: Apache-2.0
#include "surface/labels/label_smoothing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "surface/labels/label_graph.h"
#include "surface/labels/label_lines.h"

static const char what[] = "the smoothing of the labels";

/* ROUNDS: the filter is applied this many times, each time followed by clamping vertices to their boxes; the
 * second round removes the kinks that the first clamping causes. */
enum { ROUNDS = 2, MOST_TERMS = 128, NODES = 512, GRAIN = 4096 };

/* Eigenvalue 1 - k of a wave: k = per_length2 / length^2. (2 pi)^2 / 8, for neighbours at the mean distance
 * in the tetrahedra of voxels, sqrt(1 / 2). */
static const double per_length2 = 4.93;
static const double least_term = 1e-4;
/* Radius around a line within which interfaces are fitted to locate it, in lengths of smoothing. */
static const double near_lines = 1.02;

typedef struct work {
    const label_smoothing *s;
    const vec3 *from; /* positions before smoothing */
    label_graph graph;
    vec3 *old, *now;            /* the last two terms of the recurrence; the next one replaces the older */
    vec3 *sum;                  /* sum of the terms so far: the vertices of the mesh */
    double factor;              /* coefficient of the next term */
    const vec3 *normal;         /* per vertex */
    const unsigned char *rings; /* number of edges from each vertex to a line; RINGS + 1 if there are more
                                 * than RINGS */
    bool begins;                /* the next term is the first mean */
    bool corners_stay;          /* corners of lines are fixed, since they were fitted to their interfaces */
} work;

/* ---- the filter */

static bool is_at_end(const label_smoothing *s, vec3 x)
{
    const double at[3] = {x.x, x.y, x.z};
    bool is = false;
    for (int k = 0; k < 3; k++) is |= at[k] == 0 || at[k] == (double)(s->size[k] - 1);
    return is;
}

/* Computes the coefficients of exp(-(k / c)^2) in Chebyshev polynomials of 1 - k, with the sum 1. Returns
 * the number of coefficients that are not negligible. */
static int make_terms(double length, double term[MOST_TERMS])
{
    const double c = per_length2 / (length * length);
    double sum = 0;
    int count = 0;
    for (int n = 0; n < MOST_TERMS; n++) {
        term[n] = 0;
        for (int j = 0; j < NODES; j++) {
            const double angle = M_PI * (j + 0.5) / NODES, k = (1 - elementary_cos(angle)) / c;
            term[n] += (n == 0 ? 1.0 : 2.0) / NODES * elementary_exp(-k * k) * elementary_cos(n * angle);
        }
        if (fabs(term[n]) > least_term) count = n + 1;
    }
    for (int n = 0; n < count; n++) sum += term[n];
    for (int n = 0; n < count; n++) term[n] /= sum;
    return count;
}

/* The number of neighbours whose mean smooths a vertex: on a line, its neighbours along the line; 0 for a
 * fixed corner. */
static size_t count_smoothing(const work *w, size_t v)
{
    const label_graph *g = &w->graph;
    if (g->along[v] == 0) return g->first[v + 1] - g->first[v];
    return w->corners_stay && g->along[v] > 2 && !is_at_end(w->s, w->from[v]) ? 0 : g->along[v];
}

static void next_term(void *context, int worker, size_t begin, size_t end)
{
    const work *w = context;
    (void)worker;
    for (size_t v = begin; v < end; v++) {
        vec3 mean = {0, 0, 0};
        const label_graph *g = &w->graph;
        const size_t first = g->first[v], count = count_smoothing(w, v);
        for (size_t i = first; i < first + count; i++) mean = vec3_add(mean, w->now[g->neighbour[i]]);
        mean = count > 0 ? vec3_scale(mean, 1.0 / (double)count) : w->now[v];
        w->old[v] = w->begins ? mean : vec3_axpy(-1, w->old[v], vec3_scale(mean, 2));
        w->sum[v] = vec3_axpy(w->factor, w->old[v], w->sum[v]);
    }
}

static double clamped(double x, double from, double limit, int64_t size)
{
    if (from == 0 || from == (double)(size - 1)) return from;
    return fmin(fmax(x, from - limit), from + limit);
}

/* Sets the vertices of m to the positions `to`, clamped to their boxes. */
static void bring_back(const work *w, const vec3 *to, mesh *m)
{
    for (size_t v = 0; v < m->vertex_count; v++) {
        const double limit = (double)w->s->limit[v];
        m->vertex[v] = (vec3){clamped(to[v].x, w->from[v].x, limit, w->s->size[0]),
                              clamped(to[v].y, w->from[v].y, limit, w->s->size[1]),
                              clamped(to[v].z, w->from[v].z, limit, w->s->size[2])};
    }
}

/* One round: applies the filter to the mesh, then clamps the vertices to their boxes. */
static void apply_terms(work *w, mesh *m, const double *term, int count, threads *pool)
{
    const size_t vertices = m->vertex_count;
    memcpy(w->now, m->vertex, vertices * sizeof *w->now);
    w->sum = m->vertex;
    for (size_t v = 0; v < vertices; v++) w->sum[v] = vec3_scale(w->sum[v], term[0]);
    for (int n = 1; n < count; n++) {
        w->factor = term[n];
        w->begins = n == 1;
        threads_run(pool, vertices, GRAIN, next_term, w);
        vec3 *older = w->now;
        w->now = w->old;
        w->old = older;
    }
    bring_back(w, m->vertex, m);
}

static bool any_line(const label_graph *g, size_t vertices)
{
    bool any = false;
    for (size_t v = 0; v < vertices; v++) any |= g->along[v] > 0;
    return any;
}

/* The smoothed interfaces determine the positions of the lines. Then the interfaces are smoothed again
 * between their lines. */
static bool fit_lines(work *w, mesh *m, threads *pool, error *e)
{
    const label_lines lines = {m, &w->graph, w->from, near_lines * w->s->length};
    memcpy(w->old, w->from, m->vertex_count * sizeof *w->old);
    if (!label_lines_fit(&lines, pool, w->old, e)) return false;
    bring_back(w, w->old, m);
    return true;
}

/* ---- beside lines */

/* Fitting may move lines past the vertices beside them. These are redistributed tangentially, up to RINGS
 * edges away from lines, in SPREADS passes. */
enum { RINGS = 3, SPREADS = 10 };

static void count_rings(const label_graph *g, size_t vertices, unsigned char *rings)
{
    for (size_t v = 0; v < vertices; v++) rings[v] = g->along[v] > 0 ? 0 : RINGS + 1;
    for (unsigned char ring = 0; ring < RINGS; ring++)
        for (size_t v = 0; v < vertices; v++)
            for (size_t i = g->first[v]; rings[v] == ring && i < g->first[v + 1]; i++)
                if (rings[g->neighbour[i]] > ring + 1) rings[g->neighbour[i]] = (unsigned char)(ring + 1);
}

/* Moves vertices to the mean of their neighbours, without the component along the normal. */
static void spread_some(void *context, int worker, size_t begin, size_t end)
{
    const work *w = context;
    (void)worker;
    for (size_t v = begin; v < end; v++) {
        const label_graph *g = &w->graph;
        const size_t count = g->first[v + 1] - g->first[v];
        vec3 sum = {0, 0, 0};
        if (w->rings[v] == 0 || w->rings[v] > RINGS || count == 0 || !(vec3_norm2(w->normal[v]) > 0))
            continue;
        for (size_t i = g->first[v]; i < g->first[v + 1]; i++) sum = vec3_add(sum, w->now[g->neighbour[i]]);
        const vec3 n = vec3_unit(w->normal[v]), off = vec3_axpy(-(double)count, w->now[v], sum);
        w->sum[v] = vec3_axpy(1.0 / (double)count, vec3_axpy(-vec3_dot(off, n), n, off), w->now[v]);
    }
}

/* Lists the triangles at redistributed vertices: only these vertices need normals. Returns their number. */
static size_t list_beside_lines(const work *w, const mesh *m, uint32_t (*out)[3])
{
    size_t count = 0;
    for (size_t n = 0; n < m->triangle_count; n++) {
        bool beside = false;
        for (int k = 0; k < 3; k++) {
            const unsigned char rings = w->rings[m->triangle[n][k]];
            beside |= rings > 0 && rings <= RINGS;
        }
        if (beside) memcpy(out[count++], m->triangle[n], sizeof *out);
    }
    return count;
}

static bool spread(work *w, mesh *m, threads *pool, error *e)
{
    unsigned char *rings = mem_array(m->vertex_count, 1, what, e);
    uint32_t(*beside)[3] = mem_array(m->triangle_count, sizeof *beside, what, e);
    const bool ok = rings && beside;
    if (ok) {
        count_rings(&w->graph, m->vertex_count, rings);
        w->rings = rings;
        w->normal = w->old;
        w->sum = m->vertex;
        const mesh there = {m->vertex_count, list_beside_lines(w, m, beside), m->vertex, beside, false};
        for (int k = 0; k < SPREADS && there.triangle_count > 0; k++) {
            label_graph_normals(&there, w->old);
            memcpy(w->now, m->vertex, m->vertex_count * sizeof *w->now);
            threads_run(pool, m->vertex_count, GRAIN, spread_some, w);
        }
    }
    free(rings);
    free(beside);
    return ok;
}

bool label_smoothing_apply(const label_smoothing *s, mesh *m, const uint32_t *kind, threads *pool, error *e)
{
    work w = {.s = s};
    vec3 *room[3] = {NULL};
    double term[MOST_TERMS];
    if (!(s->length > 0)) return true;
    bool ok = label_graph_make(m, kind, &w.graph, e);
    for (int k = 0; ok && k < 3; k++)
        ok = (room[k] = mem_array(m->vertex_count, sizeof(vec3), what, e)) != NULL;
    if (ok) {
        const int count = make_terms(s->length, term);
        memcpy(room[0], m->vertex, m->vertex_count * sizeof(vec3));
        w.from = room[0];
        w.old = room[1];
        w.now = room[2];
        const bool has_lines = any_line(&w.graph, m->vertex_count);
        if (has_lines) {
            apply_terms(&w, m, term, count, pool);
            ok = fit_lines(&w, m, pool, e);
        }
        w.corners_stay = true;
        for (int round = 0; ok && round < ROUNDS; round++) apply_terms(&w, m, term, count, pool);
        ok = ok && (!has_lines || spread(&w, m, pool, e));
    }
    for (int k = 0; k < 3; k++) free(room[k]);
    label_graph_free(&w.graph);
    return ok;
}
