// SPDX-License-Identifier: Apache-2.0
#include "surface/labels/label_lines.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/isa.h"
#include "base/core/memory.h"
#include "geometry/space/cholesky.h"
#include "geometry/space/sym3.h"

static const char what[] = "the lines between labels";

/* PLANE, TERMS: number of coefficients of a plane and of a quadric. MOST_NEAR: maximum number of vertices of
 * a neighbourhood. MOST_KINDS: maximum number of interfaces that are fitted at a vertex. */
enum { PLANE = 3, TERMS = 6, MOST_NEAR = 8192, MOST_KINDS = 8, GRAIN = 64 };

/* Regularisation. plane_stiffness: relative to the sum of the weights, on the terms of the plane.
 * curvature_stiffness: on the quadratic terms; small, since a larger value flattens quadrics towards their
 * ends. rest: on the displacement of a vertex in directions that no interface determines. */
static const double plane_stiffness = 1e-5, curvature_stiffness = 1e-3, rest = 1e-2;
/* Weight of a midpoint between two voxels if the surface separates both voxels; otherwise the weight is 1 +
 * between_weight. */
static const double between_weight = 0.01;
/* Maximum number of passes of a fit. Each pass determines the weights from the surface of the previous pass.
 * The fit ends early if a pass changes normal and offset by less than `at_rest`, in radii. */
enum { PASSES = 7 };
static const double at_rest = 1e-3;
/* Factor of the initial radius at a junction of lines: each interface has a corner there, and thus fewer
 * voxels. */
static const double wider = 1.4;
static const double least_weight = 3; /* minimum sum of weights for a fit */
/* The radius of a fit grows by the factor `growth`, at most GROWTHS times, while the rms residual is at most
 * `most_missed` voxels: more voxels determine a smooth interface better. The fit of a plane ends early if
 * the residual exceeds `hopeless` times `most_missed`. */
static const double growth = 1.4, most_missed = 0.01, hopeless = 4;
enum { GROWTHS = 2 };
static const double most_stretch = 2;

typedef struct work {
    const label_lines *l;
    const vec3 *normal;     /* per vertex: the sum of the normals of its triangles */
    const uint32_t *fitted; /* per vertex of a line: the vertex at which its interfaces are fitted */
    const bool *beside;     /* per vertex: a neighbour is on a line */
    vec3 *out;
    struct scratch *scratch; /* per worker */
} work;

/* The neighbourhood of a vertex: vertices that are on no line, within a radius, and connected with the
 * vertex by edges. */
typedef struct neighbourhood {
    uint32_t vertex[MOST_NEAR];
    size_t count;
    double radius;
    uint16_t place[4 * MOST_NEAR]; /* hash table with open addressing: index of a vertex in `vertex` plus 1,
                                    * or 0 */
    uint16_t used[MOST_NEAR];      /* per vertex: its entry in `place` */
    bool at_end[MOST_NEAR];        /* per vertex: a neighbour of it is outside the radius */
} neighbourhood;

static void add(neighbourhood *n, uint32_t v)
{
    const size_t places = sizeof n->place / sizeof *n->place;
    size_t k = v * 0x9E3779B1u % places;
    for (; n->place[k]; k = (k + 1) % places)
        if (n->vertex[n->place[k] - 1] == v) return;
    n->used[n->count] = (uint16_t)k;
    n->vertex[n->count++] = v;
    n->place[k] = (uint16_t)n->count;
}

static void forget(neighbourhood *n)
{
    for (size_t k = 0; k < n->count; k++) n->place[n->used[k]] = 0;
    n->count = 0;
}

/* Adds the neighbours of a vertex that lie within the radius. Returns whether a neighbour lies beyond it. */
static bool add_neighbours(const label_lines *l, vec3 x, uint32_t at, neighbourhood *out)
{
    const label_graph *g = l->graph;
    bool too_far = false;
    for (size_t i = g->first[at]; i < g->first[at + 1] && out->count < MOST_NEAR; i++) {
        const uint32_t v = g->neighbour[i];
        if (g->along[v] > 0) continue;
        if (vec3_norm2(vec3_sub(l->middle[v], x)) < out->radius * out->radius)
            add(out, v);
        else
            too_far = true;
    }
    return too_far;
}

/* Adds the vertices around `start`. After the radius has increased, only vertices with neighbours outside
 * the previous radius are visited again. */
static void gather(const label_lines *l, uint32_t start, neighbourhood *out)
{
    const vec3 x = l->m->vertex[start];
    const size_t known = out->count;
    add_neighbours(l, x, start, out);
    for (size_t next = 0; next < out->count; next++)
        if (next >= known || out->at_end[next])
            out->at_end[next] = add_neighbours(l, x, out->vertex[next], out);
}

/* Weight of midpoints at vertices beside a line: near a line an interface may lack voxels, because its label
 * ends in a wedge. */
static const double beside_weight = 0.5;

static void find_beside(const label_graph *g, size_t vertices, bool *beside)
{
    for (size_t v = 0; v < vertices; v++)
        for (size_t i = g->first[v]; i < g->first[v + 1] && !beside[v]; i++)
            beside[v] = g->along[g->neighbour[i]] > 0;
}

static bool is_half(double x)
{
    return x != (double)(int64_t)x;
}

/* Vector between the two voxels of a midpoint, up to sign: 1 along the axes in which they differ. The
 * midpoint has half-integer coordinates there. */
static vec3 apart_at(vec3 middle)
{
    return (vec3){is_half(middle.x), is_half(middle.y), is_half(middle.z)};
}

/* AT_ONCE midpoints between voxels of one interface, in SIMD lanes; unused lanes of the last group have
 * weight 0. Lengths are in radii. */
enum { AT_ONCE = 8 };

typedef struct midpoint_group {
    double off[3][AT_ONCE];   /* from the vertex to the midpoint */
    double apart[3][AT_ONCE]; /* vector between the two voxels */
    double near[AT_ONCE], weight[AT_ONCE];
} midpoint_group;

typedef struct midpoints {
    size_t count;
    double near, weight; /* sums over all midpoints */
    midpoint_group at[MOST_NEAR / AT_ONCE];
} midpoints;

/* Working memory of one thread. */
typedef struct scratch {
    neighbourhood near;
    midpoints midpoints;
} scratch;

static void put(double to[3][AT_ONCE], size_t lane, vec3 x)
{
    for (int k = 0; k < 3; k++) to[k][lane] = vec3_get(x, k);
}

ISA_INLINE vec3 get(const double from[3][AT_ONCE], int lane)
{
    return (vec3){from[0][lane], from[1][lane], from[2][lane]};
}

static void list_between(const work *w, const neighbourhood *n, uint32_t kind, vec3 x, midpoints *out)
{
    out->count = 0;
    out->near = out->weight = 0;
    for (size_t k = 0; k < n->count; k++) {
        const uint32_t v = n->vertex[k];
        if (w->l->graph->kind[v] != kind) continue;
        const vec3 middle = w->l->middle[v], off = vec3_scale(vec3_sub(middle, x), 1 / n->radius);
        const double near = fmax(1 - vec3_norm2(off), 0),
                     weight = near * near * (w->beside[v] ? beside_weight : 1);
        midpoint_group *to = &out->at[out->count / AT_ONCE];
        const size_t lane = out->count++ % AT_ONCE;
        if (lane == 0) *to = (midpoint_group){0};
        put(to->off, lane, off);
        put(to->apart, lane, vec3_scale(apart_at(middle), 1 / n->radius));
        to->near[lane] = near;
        to->weight[lane] = weight;
        out->near += near;
        out->weight += weight;
    }
}

/* Height over a plane: term[0] + term[1] s + term[2] t + f (term[3] s^2 + term[4] s t + term[5] t^2), in
 * radii. The factor f (see stretch) replaces squared distances in the plane by squared distances in space,
 * so that a sphere is represented exactly. */
typedef struct quadric {
    vec3 u, v, up;
    int terms; /* PLANE: the quadratic terms are 0 */
    double term[TERMS];
} quadric;

/* The squared distance from the origin over the squared distance of its projection onto the plane, at most
 * most_stretch. */
ISA_INLINE double stretch(vec3 off, double s, double t)
{
    const double flat = s * s + t * t, all = vec3_norm2(off);
    return all < most_stretch * flat ? all / flat : most_stretch;
}

/* Signed distance of a midpoint from the surface, along `up`. *most: the largest distance at which the
 * surface still separates the two voxels. */
ISA_INLINE double above(const quadric *q, int terms, vec3 off, vec3 apart, double *most)
{
    const double *c = q->term, s = vec3_dot(off, q->u), t = vec3_dot(off, q->v),
                 along_s = c[1] + 2 * c[3] * s + c[4] * t, along_t = c[2] + 2 * c[5] * t + c[4] * s;
    *most = 0.5 *
            fabs(vec3_dot(apart, q->up) - along_s * vec3_dot(apart, q->u) - along_t * vec3_dot(apart, q->v));
    const double bend = terms > PLANE ? stretch(off, s, t) * (c[3] * s * s + c[4] * s * t + c[5] * t * t) : 0;
    return vec3_dot(off, q->up) - (c[0] + c[1] * s + c[2] * t + bend);
}

/* The terms of the surface at a midpoint, then its height, as one vector: sums of its products with each
 * term are the normal equations. */
typedef double row __attribute__((vector_size(8 * sizeof(double))));

typedef struct sums {
    row of[TERMS];
    double missed;
} sums;

/* For AT_ONCE midpoints: coordinates in the plane, heights, weights and squared residuals. */
typedef struct heights {
    double s[AT_ONCE], t[AT_ONCE], stretch[AT_ONCE], up[AT_ONCE], weight[AT_ONCE], missed[AT_ONCE];
} heights;

ISA_INLINE void find_heights(const midpoint_group *m, const quadric *before, const quadric *q, int terms,
                             heights *out)
{
    for (int l = 0; l < AT_ONCE; l++) {
        vec3 off = get(m->off, l);
        double weight = m->weight[l], most, missed = 0;
        if (before) {
            const double up = above(before, terms, off, get(m->apart, l), &most), over = fabs(up) - most,
                         back = (up > 0 ? -most : most) / (1 + between_weight);
            const vec3 brought = vec3_axpy(back, before->up, off);
            const bool misses = over > 0;
            missed = misses ? m->near[l] * over * over : 0;
            off = (vec3){misses ? brought.x : off.x, misses ? brought.y : off.y, misses ? brought.z : off.z};
            weight *= misses ? 1 + between_weight : between_weight;
        }
        out->s[l] = vec3_dot(off, q->u);
        out->t[l] = vec3_dot(off, q->v);
        out->up[l] = vec3_dot(off, q->up);
        out->stretch[l] = terms > PLANE ? stretch(off, out->s[l], out->t[l]) : 0;
        out->weight[l] = weight;
        out->missed[l] = missed;
    }
}

ISA_INLINE void sum_terms(const midpoints *m, const quadric *before, const quadric *q, int terms, sums *out)
{
    row sum[TERMS] = {0};
    double missed = 0;
    for (size_t k = 0; k < m->count; k += AT_ONCE) {
        heights h;
        find_heights(&m->at[k / AT_ONCE], before, q, terms, &h);
        for (int l = 0; l < AT_ONCE; l++) { /* the order of the sums is the same for every instruction set */
            const double s = h.s[l], t = h.t[l], f = h.stretch[l];
            const row r = terms > PLANE ? (row){1, s, t, f * s * s, f * s * t, f * t * t, h.up[l]}
                                        : (row){1, s, t, h.up[l]};
            for (int i = 0; i < terms; i++) sum[i] += h.weight[l] * r[i] * r;
            missed += h.missed[l];
        }
    }
    memcpy(out->of, sum, sizeof sum);
    out->missed = missed;
}

ISA_CLONES static void sum_plane(const midpoints *m, const quadric *before, const quadric *q, sums *out)
{
    if (before)
        sum_terms(m, before, q, PLANE, out);
    else
        sum_terms(m, NULL, q, PLANE, out);
}

ISA_CLONES static void sum_quadric(const midpoints *m, const quadric *before, const quadric *q, sums *out)
{
    if (before)
        sum_terms(m, before, q, TERMS, out);
    else
        sum_terms(m, NULL, q, TERMS, out);
}

/* Fits the terms by weighted least squares. Without `before`, to the midpoints. With it, to the residuals by
 * which the surface `before` does not separate the voxels. *missed: the rms residual, in radii. False: the
 * sum of weights is too small. */
static bool fit_terms(const midpoints *m, const quadric *before, quadric *q, double *missed)
{
    double a[TERMS][TERMS];
    sums sum;
    *missed = 0;
    if (m->weight < least_weight) return false;
    (q->terms > PLANE ? sum_quadric : sum_plane)(m, before, q, &sum);
    *missed = sqrt(sum.missed / m->near);
    memset(q->term, 0, sizeof q->term);
    for (int i = 0; i < q->terms; i++) {
        for (int j = 0; j < q->terms; j++) a[i][j] = sum.of[i][j];
        a[i][i] += i < PLANE ? plane_stiffness * sum.of[0][0] : curvature_stiffness;
        q->term[i] = sum.of[i][q->terms];
    }
    cholesky_solve(&a[0][0], TERMS, q->terms, q->term);
    return true;
}

/* The normal of the surface at the origin. *length: length of (-term[1], -term[2], 1). */
static vec3 normal_of(const quadric *q, double *length)
{
    *length = sqrt(1 + q->term[1] * q->term[1] + q->term[2] * q->term[2]);
    return vec3_scale(vec3_axpy(-q->term[1], q->u, vec3_axpy(-q->term[2], q->v, q->up)), 1 / *length);
}

/* The tangent plane of an interface near a vertex: it passes through the point at `distance` from the vertex
 * along `normal`. */
typedef struct tangent_plane {
    uint32_t kind;
    bool is_known, grows;
    vec3 normal;
    double distance;
} tangent_plane;

/* Fits a plane or quadric with `terms` coefficients; sets normal and distance of p. *missed: the rms
 * residual, in voxels. False: there are too few midpoints. */
static bool fit_quadric(const midpoints *m, double radius, int terms, tangent_plane *p, double *missed)
{
    quadric q = {.terms = terms}, before;
    double length;
    for (int pass = 0; pass < PASSES; pass++) { /* each pass uses the tangent plane of the previous one as
                                                 * its plane */
        before = q;
        q.up = p->normal;
        vec3_frame(q.up, &q.u, &q.v);
        if (!fit_terms(m, pass > 0 ? &before : NULL, &q, missed)) return false;
        *missed *= radius;
        p->normal = normal_of(&q, &length);
        const double turned = vec3_norm(vec3_sub(p->normal, q.up)),
                     shifted = fabs(q.term[0] - before.term[0]);
        if (pass > 1 && turned < at_rest && shifted < at_rest) break;
        if (pass > 1 && terms == PLANE && *missed > hopeless * most_missed) break;
    }
    p->distance = radius * q.term[0] / length;
    return true;
}

/* Fits one interface in the present neighbourhood: a plane, and if its residual is too large, a quadric. The
 * fit is stored if its residual is small enough, or if there is none yet. */
static void fit(const work *w, scratch *on, vec3 x, tangent_plane *p)
{
    const neighbourhood *n = &on->near;
    vec3 sum = {0, 0, 0};
    p->grows = false;
    for (size_t k = 0; k < n->count; k++)
        if (w->l->graph->kind[n->vertex[k]] == p->kind) sum = vec3_add(sum, w->normal[n->vertex[k]]);
    if (!(vec3_norm2(sum) > 0)) return;
    list_between(w, n, p->kind, x, &on->midpoints);
    for (int terms = PLANE; terms <= TERMS && !p->grows; terms += TERMS - PLANE) {
        tangent_plane found = {.kind = p->kind, .is_known = true, .normal = vec3_unit(sum)};
        double missed;
        if (!fit_quadric(&on->midpoints, n->radius, terms, &found, &missed)) return;
        p->grows = found.grows = missed <= most_missed;
        if (p->grows || (terms == TERMS && !p->is_known)) *p = found;
    }
}

static int list_interfaces(const label_graph *g, const neighbourhood *n, tangent_plane out[MOST_KINDS])
{
    int count = 0;
    for (size_t k = 0; k < n->count && count < MOST_KINDS; k++) {
        const uint32_t kind = g->kind[n->vertex[k]];
        bool listed = false;
        for (int i = 0; i < count; i++) listed |= out[i].kind == kind;
        if (!listed) out[count++] = (tangent_plane){.kind = kind, .grows = true};
    }
    return count;
}

/* Fits the interfaces near a vertex of a line. Returns their number. */
static int fit_interfaces(const work *w, scratch *on, uint32_t v, tangent_plane out[MOST_KINDS])
{
    const label_graph *g = w->l->graph;
    neighbourhood *near = &on->near;
    int count = 0;
    bool grows = true;
    forget(near);
    near->radius = w->l->radius * (g->along[v] > 2 ? wider : 1);
    for (int k = 0; grows && k <= GROWTHS; k++, near->radius *= growth) {
        gather(w->l, v, near);
        if (k == 0) count = list_interfaces(g, near, out);
        /* the neighbourhood is full: a larger radius adds nothing */
        if (k > 0 && near->count == MOST_NEAR) break;
        grows = false;
        for (int i = 0; i < count; i++) {
            if (out[i].grows) fit(w, on, w->l->m->vertex[v], &out[i]);
            grows |= out[i].grows;
        }
    }
    return count;
}

/* Moves `place` to the point with the least sum of squared distances from the planes of all interfaces,
 * which were fitted at x. */
static vec3 place_on(const tangent_plane *p, int count, vec3 x, vec3 place)
{
    sym3 a = {rest, rest, rest, 0, 0, 0};
    vec3 b = {0, 0, 0};
    for (int i = 0; i < count; i++) {
        const vec3 n = p[i].normal;
        if (!p[i].is_known) continue;
        a = (sym3){a.xx + n.x * n.x, a.yy + n.y * n.y, a.zz + n.z * n.z,
                   a.xy + n.x * n.y, a.xz + n.x * n.z, a.yz + n.y * n.z};
        b = vec3_axpy(p[i].distance - vec3_dot(n, vec3_sub(place, x)), n, b);
    }
    return vec3_add(place, sym3_solve(a, b));
}

/* The next vertex along a line after v, where `before` is the previous one. */
static uint32_t next_along(const label_graph *g, uint32_t before, uint32_t v)
{
    const uint32_t *ends = g->neighbour + g->first[v];
    return ends[ends[0] == before];
}

static void move_lines(void *context, int worker, size_t begin, size_t end)
{
    const work *w = context;
    const label_graph *g = w->l->graph;
    const vec3 *at = w->l->m->vertex;
    tangent_plane p[MOST_KINDS];
    for (size_t v = begin; v < end; v++) {
        if (g->along[v] == 0 || w->fitted[v] != v) continue;
        const int count = fit_interfaces(w, &w->scratch[worker], (uint32_t)v, p);
        w->out[v] = place_on(p, count, at[v], at[v]);
        for (size_t i = g->first[v]; i < g->first[v] + g->along[v]; i++) {
            uint32_t before = (uint32_t)v, u = g->neighbour[i];
            while (u != v && w->fitted[u] == v) {
                w->out[u] = place_on(p, count, at[v], at[u]);
                const uint32_t next = next_along(g, before, u);
                before = u;
                u = next;
            }
        }
    }
}

/* A fit is used for all vertices of a line within this distance, in voxels; a corner has its own. With 2,
 * lines on spheres of radius 10 would be off by up to 0.2 voxels; with less, fits cost more time. */
static const double alike = 1;

static void choose_fitted(const label_lines *l, uint32_t *fitted)
{
    const label_graph *g = l->graph;
    const vec3 *at = l->m->vertex;
    for (size_t v = 0; v < l->m->vertex_count; v++) fitted[v] = UINT32_MAX;
    for (size_t v = 0; v < l->m->vertex_count; v++) {
        if (g->along[v] == 0 || fitted[v] != UINT32_MAX) continue;
        fitted[v] = (uint32_t)v;
        for (size_t i = g->first[v]; g->along[v] == 2 && i < g->first[v] + 2; i++) {
            uint32_t before = (uint32_t)v, u = g->neighbour[i];
            while (g->along[u] == 2 && fitted[u] == UINT32_MAX &&
                   vec3_norm2(vec3_sub(at[u], at[v])) <= alike * alike) {
                fitted[u] = (uint32_t)v;
                const uint32_t next = next_along(g, before, u);
                before = u;
                u = next;
            }
        }
    }
}

bool label_lines_fit(const label_lines *l, threads *pool, vec3 *out, error *e)
{
    const size_t count = l->m->vertex_count;
    vec3 *normal = mem_array(count, sizeof *normal, what, e);
    uint32_t *fitted = mem_array(count, sizeof *fitted, what, e);
    bool *beside = mem_array(count, sizeof *beside, what, e);
    scratch *room = mem_array((size_t)threads_count(pool), sizeof *room, what, e);
    const bool ok = normal && fitted && beside && room;
    if (ok) {
        label_graph_normals(l->m, normal);
        choose_fitted(l, fitted);
        find_beside(l->graph, count, beside);
        work w = {l, normal, fitted, beside, out, room};
        threads_run(pool, count, GRAIN, move_lines, &w);
    }
    free(normal);
    free(fitted);
    free(beside);
    free(room);
    return ok;
}
