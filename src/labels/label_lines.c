#include "labels/label_lines.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "geometry/sym3.h"

static const char what[] = "the lines between labels";

/* Coefficients of a quadric over a plane; vertices that are looked at, and interfaces that meet, around one. */
enum { TERMS = 6, MOST_NEAR = 4096, MOST_KINDS = 8, GRAIN = 64 };

/* What holds a plane back, as a share of the weights, and curvature: little, lest quadrics are flat at their ends; and a
 * vertex where no interface would hold it. */
static const double plane_stiffness = 1e-5, curvature_stiffness = 1e-3, rest = 1e-2;
/* A middle counts by so much where the quadric passes between both of its voxels: farther off it counts whole. */
static const double between_weight = 0.01;
enum { PASSES = 7 }; /* of a quadric, each of which knows from the one before where it passes */
/* Where lines meet each interface has a corner, of fewer voxels: these are looked for farther away. */
static const double wider = 1.4;
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
    double radius;
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
            if (g->along[v] == 0 && vec3_norm2(vec3_sub(l->middle[v], x)) < out->radius * out->radius)
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

/* A height over a plane: term[0] + term[1] s + term[2] t + term[3] s^2 + term[4] s t + term[5] t^2, in radii. */
typedef struct quadric {
    vec3 u, v, up;
    double term[TERMS];
} quadric;

/* How far up a place lies from the quadric: no more than `most` where this passes between two voxels `apart`. */
static double above(const quadric *q, vec3 off, vec3 apart, double *most)
{
    const double *c = q->term, s = vec3_dot(off, q->u), t = vec3_dot(off, q->v),
                 along_s = c[1] + 2 * c[3] * s + c[4] * t, along_t = c[2] + 2 * c[5] * t + c[4] * s;
    *most = 0.5 *
            fabs(vec3_dot(apart, q->up) - along_s * vec3_dot(apart, q->u) - along_t * vec3_dot(apart, q->v));
    return vec3_dot(off, q->up) - (c[0] + s * (c[1] + c[3] * s + c[4] * t) + t * (c[2] + c[5] * t));
}

/* From one voxel to the other of a middle: it has half a voxel along the axes in which they differ. */
static vec3 apart_at(vec3 middle)
{
    return (vec3){middle.x != floor(middle.x), middle.y != floor(middle.y), middle.z != floor(middle.z)};
}

/* Makes the quadric's terms anew, over its plane, by least squares: of the middles, and where there is a quadric before, of
 * by how much that one does not pass between their voxels. */
static bool fit_terms(const work *w, const near_by *n, uint32_t kind, vec3 x, const quadric *before,
                      quadric *q)
{
    const label_lines *l = w->l;
    double a[TERMS][TERMS] = {{0}}, *b = q->term, all = 0, counted = 0;
    memset(b, 0, sizeof q->term);
    for (size_t k = 0; k < n->count; k++) {
        if (l->graph->kind[n->vertex[k]] != kind) continue;
        const vec3 middle = l->middle[n->vertex[k]];
        vec3 off = vec3_scale(vec3_sub(middle, x), 1 / n->radius);
        const double near = fmax(1 - vec3_norm2(off), 0);
        double weight = near * near * (is_beside_line(l->graph, n->vertex[k]) ? beside_weight : 1), most;
        all += weight;
        if (before) {
            const double up = above(before, off, vec3_scale(apart_at(middle), 1 / n->radius), &most);
            if (fabs(up) > most) {
                off = vec3_axpy((up > 0 ? -most : most) / (1 + between_weight), before->up, off);
                weight *= 1 + between_weight;
            } else {
                weight *= between_weight;
            }
        }
        const double s = vec3_dot(off, q->u), t = vec3_dot(off, q->v),
                     term[TERMS] = {1, s, t, s * s, s * t, t * t};
        for (int i = 0; i < TERMS; i++) {
            for (int j = 0; j <= i; j++) a[i][j] += weight * term[i] * term[j];
            b[i] += weight * term[i] * vec3_dot(off, q->up);
        }
        counted += weight;
    }
    if (all < least_weight) return false;
    for (int i = 0; i < TERMS; i++) a[i][i] += i < 3 ? plane_stiffness * counted : curvature_stiffness;
    solve(a, b);
    return true;
}

/* Its normal over x; *length: of (-term[1], -term[2], 1). */
static vec3 normal_of(const quadric *q, double *length)
{
    *length = sqrt(1 + q->term[1] * q->term[1] + q->term[2] * q->term[2]);
    return vec3_scale(vec3_axpy(-q->term[1], q->u, vec3_axpy(-q->term[2], q->v, q->up)), 1 / *length);
}

/* The plane, through a place at *distance along *normal from x, in which the interface `kind` passes by x. */
static bool fit(const work *w, const near_by *n, uint32_t kind, vec3 x, vec3 *normal, double *distance)
{
    vec3 sum = {0, 0, 0};
    double length;
    quadric q, before;
    for (size_t k = 0; k < n->count; k++)
        if (w->l->graph->kind[n->vertex[k]] == kind) sum = vec3_add(sum, w->normal[n->vertex[k]]);
    if (!(vec3_norm2(sum) > 0)) return false;
    *normal = vec3_unit(sum);
    for (int pass = 0; pass < PASSES; pass++) { /* each over the plane that the one before has at x */
        before = q;
        q.up = *normal;
        vec3_frame(q.up, &q.u, &q.v);
        if (!fit_terms(w, n, kind, x, pass > 0 ? &before : NULL, &q)) return false;
        *normal = normal_of(&q, &length);
    }
    *distance = n->radius * q.term[0] / length;
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
    near.radius = w->l->radius * (g->along[v] > 2 ? wider : 1);
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
