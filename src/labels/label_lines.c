#include "labels/label_lines.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "geometry/sym3.h"

static const char what[] = "the lines between labels";

/* Coefficients of a quadric over a plane; vertices that are looked at, and interfaces that meet, around one. */
enum { TERMS = 6, MOST_NEAR = 1024, MOST_KINDS = 8, GRAIN = 64 };

/* What holds curvature back where few vertices would tell it, and a vertex where no interface would: in their weights. */
static const double stiffness = 1e-2, rest = 1e-2;
static const double least_weight = 3; /* of the vertices of an interface */

typedef struct work {
    const label_lines *l;
    const vec3 *normal; /* of each vertex: the sum of its triangles' */
    vec3 *out;
} work;

/* The vertices on no line that are near one and hang together with it. */
typedef struct near_by {
    uint32_t vertex[MOST_NEAR];
    size_t count;
    uint16_t place[4 * MOST_NEAR]; /* open addressing: one more than a vertex's place, or 0 */
} near_by;

static void add(near_by *n, uint32_t v)
{
    const size_t places = sizeof n->place / sizeof *n->place;
    size_t k = v * 0x9E3779B1u % places;
    for (; n->place[k]; k = (k + 1) % places)
        if (n->vertex[n->place[k] - 1] == v) return;
    n->vertex[n->count++] = v;
    n->place[k] = (uint16_t)n->count;
}

static void gather(const label_lines *l, uint32_t start, near_by *out)
{
    const label_graph *g = l->graph;
    const vec3 x = l->m->vertex[start];
    uint32_t at = start;
    out->count = 0;
    memset(out->place, 0, sizeof out->place);
    for (size_t next = 0;; at = out->vertex[next++]) {
        for (size_t i = g->first[at]; i < g->first[at + 1] && out->count < MOST_NEAR; i++) {
            const uint32_t v = g->neighbour[i];
            if (g->along[v] == 0 && vec3_norm2(vec3_sub(l->middle[v], x)) < l->radius * l->radius)
                add(out, v);
        }
        if (next == out->count) break;
    }
}

/* Solves the symmetric positive definite system in place (Cholesky). */
static void solve(double a[TERMS][TERMS], double b[TERMS])
{
    for (int i = 0; i < TERMS; i++) {
        for (int j = 0; j <= i; j++) {
            double sum = a[i][j];
            for (int k = 0; k < j; k++) sum -= a[i][k] * a[j][k];
            a[i][j] = i == j ? sqrt(sum) : sum / a[j][j];
        }
        for (int k = 0; k < i; k++) b[i] -= a[i][k] * b[k];
        b[i] /= a[i][i];
    }
    for (int i = TERMS; i-- > 0;) {
        for (int k = i + 1; k < TERMS; k++) b[i] -= a[k][i] * b[k];
        b[i] /= a[i][i];
    }
}

/* Voxels beside a line are those of wedges, of which some are missing: they count for less. */
static const double beside_weight = 0.5;

static bool is_beside_line(const label_graph *g, uint32_t v)
{
    for (size_t i = g->first[v]; i < g->first[v + 1]; i++)
        if (g->along[g->neighbour[i]] > 0) return true;
    return false;
}

/* The plane, through a place at *distance along *normal from x, in which the interface `kind` passes by x. */
static bool fit(const work *w, const near_by *n, uint32_t kind, vec3 x, vec3 *normal, double *distance)
{
    const label_lines *l = w->l;
    vec3 sum = {0, 0, 0}, u, v;
    double a[TERMS][TERMS] = {{0}}, b[TERMS] = {0}, all = 0;
    for (size_t k = 0; k < n->count; k++)
        if (l->graph->kind[n->vertex[k]] == kind) sum = vec3_add(sum, w->normal[n->vertex[k]]);
    if (!(vec3_norm2(sum) > 0)) return false;
    const vec3 up = vec3_unit(sum);
    vec3_frame(up, &u, &v);
    for (size_t k = 0; k < n->count; k++) {
        if (l->graph->kind[n->vertex[k]] != kind) continue;
        const vec3 off = vec3_scale(vec3_sub(l->middle[n->vertex[k]], x), 1 / l->radius);
        const double near = fmax(1 - vec3_norm2(off), 0),
                     weight = near * near * (is_beside_line(l->graph, n->vertex[k]) ? beside_weight : 1),
                     s = vec3_dot(off, u), t = vec3_dot(off, v), term[TERMS] = {1, s, t, s * s, s * t, t * t};
        for (int i = 0; i < TERMS; i++) {
            for (int j = 0; j < TERMS; j++) a[i][j] += weight * term[i] * term[j];
            b[i] += weight * term[i] * vec3_dot(off, up);
        }
        all += weight;
    }
    if (all < least_weight) return false;
    for (int i = 0; i < TERMS; i++) a[i][i] += stiffness * (i < 3 ? 1e-3 : 1) * all;
    solve(a, b);
    const double length = sqrt(1 + b[1] * b[1] + b[2] * b[2]);
    *normal = vec3_scale(vec3_axpy(-b[1], u, vec3_axpy(-b[2], v, up)), 1 / length);
    *distance = l->radius * b[0] / length;
    return true;
}

/* By how much a vertex moves to lie on all interfaces that are near: the least squares of the distances. */
static vec3 move(const work *w, uint32_t v)
{
    const label_graph *g = w->l->graph;
    near_by near;
    uint32_t kinds[MOST_KINDS];
    int count = 0;
    sym3 a = {rest, rest, rest, 0, 0, 0};
    vec3 b = {0, 0, 0};
    gather(w->l, v, &near);
    for (size_t k = 0; k < near.count && count < MOST_KINDS; k++) {
        bool known = false;
        vec3 n;
        double distance;
        for (int i = 0; i < count; i++) known |= kinds[i] == g->kind[near.vertex[k]];
        if (known) continue;
        kinds[count++] = g->kind[near.vertex[k]];
        if (!fit(w, &near, kinds[count - 1], w->l->m->vertex[v], &n, &distance)) continue;
        a = (sym3){a.xx + n.x * n.x, a.yy + n.y * n.y, a.zz + n.z * n.z,
                   a.xy + n.x * n.y, a.xz + n.x * n.z, a.yz + n.y * n.z};
        b = vec3_axpy(distance, n, b);
    }
    return sym3_solve(a, b);
}

static void move_lines(void *context, int worker, size_t begin, size_t end)
{
    const work *w = context;
    (void)worker;
    for (size_t v = begin; v < end; v++)
        if (w->l->graph->along[v] > 0) w->out[v] = vec3_add(w->l->m->vertex[v], move(w, (uint32_t)v));
}

bool label_lines_fit(const label_lines *l, threads *pool, vec3 *out, error *e)
{
    const mesh *m = l->m;
    vec3 *normal = mem_array(m->vertex_count, sizeof *normal, what, e);
    if (!normal) return false;
    label_graph_normals(m, normal);
    work w = {l, normal, out};
    threads_run(pool, m->vertex_count, GRAIN, move_lines, &w);
    free(normal);
    return true;
}
