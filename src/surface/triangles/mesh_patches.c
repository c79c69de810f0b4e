// SPDX-License-Identifier: Apache-2.0
#include "surface/triangles/mesh_patches.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/compare.h"
#include "base/core/elementary.h"
#include "geometry/mesh/mesh_weld.h"
#include "base/core/memory.h"
#include "base/core/sets.h"
#include "geometry/mesh/coplanar.h"
#include "geometry/mesh/flat_triangles.h"
#include "geometry/mesh/mesh_edges.h"
#include "geometry/mesh/orientation.h"

static const char what[] = "the patches of the mesh";

/* Minimum height of a triangle over its longest edge for a reliable normal. */
static const double least_height = 1e-4;
/* A thinner triangle also has a reliable normal if its height is at least this fraction of the extent of the
 * mesh, as on the sides of a blade. Float coordinates then determine its plane to 0.01 rad. */
static const double seen_height = 1e-5;
/* Passes that copy normals to triangles without one; such triangles may be adjacent. */
enum { MOST_PASSES = 4 };
enum { TRIANGLES = 4096 }; /* of a task */

/* An edge at which patches end. */
typedef struct cut {
    uint32_t from, to;               /* vertices */
    size_t patch_first, patch_count; /* in `patches`, ascending */
    double cosine;                   /* between the normals of the two triangles; 0: there are not two */
} cut;

typedef struct patches_build {
    mesh *m;
    const mesh_patches_params *params;
    double extent; /* longest side of the mesh's box */
    const mesh_edges *edges;
    mesh_edges listed_edges; /* if they were not given */
    vec3 *normal;            /* per triangle, unit; zero: it has none */
    bool *is_cut;            /* per edge, at its first side */
    bool was_closed;         /* the mesh was closed before duplicate faces were removed */
    orientation turned;
    uint32_t *patch; /* per triangle */
    cut *cuts;
    size_t cut_count;
    uint32_t *patches; /* of the cuts */
    size_t *at;        /* vertex v has the cuts around[at[v]] .. around[at[v + 1] - 1] */
    uint32_t *around;
    bool *corner; /* per vertex */
    double bend;  /* radians: a curve that bends by more at a vertex has a corner there; 0: bends make no
                   * corners */
    mesh_patches *out;
} patches_build;

/* ---- which edges are features */

/* The normal of a triangle, zero if it is too thin, and its longest edge. */
static vec3 triangle_normal(const patches_build *k, size_t n, int *longest)
{
    const mesh *m = k->m;
    const uint32_t *t = m->triangle[n];
    const vec3 ab = vec3_sub(m->vertex[t[1]], m->vertex[t[0]]),
               ac = vec3_sub(m->vertex[t[2]], m->vertex[t[0]]), across = vec3_cross(ab, ac);
    double most = 0;
    for (int side = 0; side < 3; side++) {
        double length2 = vec3_norm2(vec3_sub(m->vertex[t[(side + 1) % 3]], m->vertex[t[side]]));
        if (length2 > most) *longest = side;
        most = fmax(most, length2);
    }
    const double twice = vec3_norm(across);
    const bool has = twice > least_height * most || twice > seen_height * k->extent * sqrt(most);
    return has ? vec3_unit(across) : (vec3){0, 0, 0};
}

static bool has_normal(vec3 n)
{
    return vec3_norm2(n) > 0;
}

/* The side of the other triangle at an edge of two triangles; NULL at other edges. *against: both
 * triangles have the edge in the same direction. */
static const mesh_side *other_side(const mesh_edges *edges, uint32_t a, uint32_t b, uint32_t triangle,
                                   bool *against)
{
    const uint32_t low = a < b ? a : b, high = a < b ? b : a;
    for (size_t k = edges->first[low]; k < edges->first[low + 1]; k++) {
        const mesh_side *s = edges->sides + k;
        if (s->other != high) continue;
        if (mesh_edges_width(edges, low, k) != 2) return NULL;
        *against = s[0].upwards == s[1].upwards;
        return s[0].triangle == triangle ? s + 1 : s;
    }
    return NULL;
}

static void normal_chunk(void *context, int worker, size_t begin, size_t end)
{
    patches_build *k = context;
    int longest;
    (void)worker;
    for (size_t n = begin; n < end; n++) k->normal[n] = triangle_normal(k, n, &longest);
}

/* Computes the normals. A triangle that is too thin gets the normal of its neighbour at its longest edge. */
static bool find_normals(patches_build *k, error *e)
{
    const mesh *m = k->m;
    k->normal = mem_array(m->triangle_count, sizeof *k->normal, what, e);
    if (!k->normal) return false;
    k->extent = m->triangle_count ? bbox_longest(mesh_box(m, k->params->pool)) : 0;
    size_t without = 0;
    int longest = 0;
    threads_run(k->params->pool, m->triangle_count, TRIANGLES, normal_chunk, k);
    if (!threads_may_go_on(k->params->pool, e)) return false;
    for (size_t n = 0; n < m->triangle_count; n++) without += !has_normal(k->normal[n]);
    for (int pass = 0; without > 0 && pass < MOST_PASSES; pass++)
        for (uint32_t n = 0; n < m->triangle_count; n++) {
            if (has_normal(k->normal[n])) continue;
            triangle_normal(k, n, &longest);
            bool against;
            const uint32_t *t = m->triangle[n];
            const mesh_side *s = other_side(k->edges, t[longest], t[(longest + 1) % 3], n, &against);
            if (!s || !has_normal(k->normal[s->triangle])) continue;
            k->normal[n] = vec3_scale(k->normal[s->triangle], against ? -1 : 1);
            without--;
        }
    return true;
}

/* The dihedral angle at an edge of two triangles, radians; 0: they are coplanar. */
static double angle_at(const patches_build *k, const mesh_side *s)
{
    const vec3 a = k->normal[s[0].triangle], b = k->normal[s[1].triangle];
    if (!has_normal(a) || !has_normal(b)) return 0;
    const vec3 turned = vec3_scale(b, s[0].upwards == s[1].upwards ? -1 : 1);
    return elementary_atan2(vec3_norm(vec3_cross(a, turned)), vec3_dot(a, turned));
}

/* Length of the edges with dihedral angles near MESH_PATCHES_ANGLE, and above. CAD models have few edges near
 * that angle, however coarse the facets of their arcs are. On scans and on decimated or coarse meshes the
 * length decreases with the angle. */
typedef struct bends {
    double near, above;
} bends;

/* near_angle: half-width of the interval, radians. most_near: largest ratio near / above of a CAD-like mesh;
 * real CAD models have .65 at most, scans .76 at least. flat_below: radians; flatter edges are not
 * examined. */
static const double near_angle = 0.15, most_near = 0.7, flat_below = 0.2;

static void bends_add(bends *b, double angle, double length)
{
    if (angle > MESH_PATCHES_ANGLE + near_angle)
        b->above += length;
    else if (angle > MESH_PATCHES_ANGLE - near_angle)
        b->near += length;
}

/* The angle above which edges, or bends of curves, are features. */
static double feature_angle(const patches_build *k, const bends *b)
{
    if (k->params->feature_angle != MESH_PATCHES_AUTOMATIC) return k->params->feature_angle;
    return b->near <= most_near * b->above ? MESH_PATCHES_ANGLE : 0;
}

/* Whether the dihedral angle of an edge is certainly below `flat_below`, as at most edges; computed
 * without the angle. */
static bool is_flat(const patches_build *k, const mesh_side *s)
{
    static const double surely = 0.99;
    const vec3 a = k->normal[s[0].triangle], b = k->normal[s[1].triangle];
    const double cosine = vec3_dot(a, b) * (s[0].upwards == s[1].upwards ? -1 : 1),
                 tangent = surely * flat_below * cosine;
    return cosine > 0 && vec3_norm2(vec3_cross(a, b)) < tangent * tangent;
}

static double length_of(const mesh *m, uint32_t a, uint32_t b)
{
    return vec3_norm(vec3_sub(m->vertex[b], m->vertex[a]));
}

static bool is_bent(const patches_build *k, const mesh_side *s, double angle)
{
    return !(angle >= flat_below && is_flat(k, s)) && angle_at(k, s) > angle;
}

/* The dihedral angle above which edges are feature edges. *is_scan: the mesh is not CAD-like. */
static double find_angle(const patches_build *k, bool *is_scan)
{
    bends all = {0};
    for (uint32_t v = 0; v < k->m->vertex_count; v++)
        for (size_t i = k->edges->first[v], n; i < k->edges->first[v + 1]; i += n) {
            n = mesh_edges_width(k->edges, v, i);
            const mesh_side *s = k->edges->sides + i;
            if (n == 2) bends_add(&all, is_flat(k, s) ? 0 : angle_at(k, s), length_of(k->m, v, s->other));
        }
    *is_scan = all.near > most_near * all.above;
    return feature_angle(k, &all);
}

/* ---- sharp edges that are not feature edges */

/* An edge between patches. */
typedef struct bent_edge {
    uint32_t end[2];
    size_t at; /* its first side */
    double angle, length;
} bent_edge;

/* Connected components of sharp edges: networks, joined at any vertex; chains, joined where exactly two
 * edges meet and bend little. */
typedef struct feature_groups {
    bent_edge *edge;
    size_t count;
    uint32_t (*at)[2], *degree; /* per vertex: the first two sharp edges there, and their number */
    uint32_t *network, *chain;  /* sets */
    double *network_length, *network_angle, *chain_length;
    size_t *chain_edges;
} feature_groups;

static void free_groups(feature_groups *g)
{
    free(g->edge);
    free(g->at);
    free(g->degree);
    free(g->network);
    free(g->chain);
    free(g->network_length);
    free(g->network_angle);
    free(g->chain_length);
    free(g->chain_edges);
}

static bool make_groups(const patches_build *k, feature_groups *g, error *e)
{
    const size_t n = k->cut_count, v = k->m->vertex_count;
    g->edge = mem_array(n, sizeof *g->edge, what, e);
    g->at = mem_array(v, sizeof *g->at, what, e);
    g->degree = mem_array(v, sizeof *g->degree, what, e);
    g->network = mem_array(n, sizeof *g->network, what, e);
    g->chain = mem_array(n, sizeof *g->chain, what, e);
    g->network_length = mem_array(n, sizeof *g->network_length, what, e);
    g->network_angle = mem_array(n, sizeof *g->network_angle, what, e);
    g->chain_length = mem_array(n, sizeof *g->chain_length, what, e);
    g->chain_edges = mem_array(n, sizeof *g->chain_edges, what, e);
    return g->edge && g->at && g->degree && g->network && g->chain && g->network_length && g->network_angle &&
           g->chain_length && g->chain_edges;
}

static void list_bent(const patches_build *k, feature_groups *g)
{
    sets_reset(g->network, k->cut_count);
    for (uint32_t v = 0; v < k->m->vertex_count; v++)
        for (size_t i = k->edges->first[v], n; i < k->edges->first[v + 1]; i += n) {
            const mesh_side *s = k->edges->sides + i;
            n = mesh_edges_width(k->edges, v, i);
            if (!k->is_cut[i]) continue;
            const uint32_t number = (uint32_t)g->count++;
            bent_edge *b = &g->edge[number];
            *b = (bent_edge){{v, s->other}, i, n == 2 ? angle_at(k, s) : M_PI, length_of(k->m, v, s->other)};
            for (int end = 0; end < 2; end++) {
                const uint32_t at = b->end[end], there = g->degree[at]++;
                if (there < 2) g->at[at][there] = number;
                if (there > 0) sets_join(g->network, number, g->at[at][0]);
            }
        }
}

/* The angle between two consecutive edges from -> v -> to, radians. */
static double bend_at_vertex(const mesh *m, uint32_t from, uint32_t v, uint32_t to)
{
    const vec3 in = vec3_sub(m->vertex[v], m->vertex[from]), out = vec3_sub(m->vertex[to], m->vertex[v]);
    return elementary_atan2(vec3_norm(vec3_cross(in, out)), vec3_dot(in, out));
}

static uint32_t end_beyond(const bent_edge *b, uint32_t v)
{
    return b->end[b->end[0] == v];
}

static void measure_groups(const patches_build *k, feature_groups *g)
{
    sets_reset(g->chain, g->count);
    for (uint32_t v = 0; v < k->m->vertex_count; v++) {
        const uint32_t *at = g->at[v];
        if (g->degree[v] == 2 && bend_at_vertex(k->m, end_beyond(&g->edge[at[0]], v), v,
                                                end_beyond(&g->edge[at[1]], v)) <= MESH_PATCHES_ANGLE)
            sets_join(g->chain, at[0], at[1]);
    }
    for (uint32_t c = 0; c < g->count; c++) {
        const uint32_t network = sets_root(g->network, c), chain = sets_root(g->chain, c);
        g->network_length[network] += g->edge[c].length;
        g->network_angle[network] = fmax(g->network_angle[network], g->edge[c].angle);
        g->chain_length[chain] += g->edge[c].length;
        g->chain_edges[chain]++;
    }
}

/* least_length: of a network, and on a scan of a chain, in spacings; a shorter one is noise or has too few
 * samples to matter. surely_bent: dihedral angle, radians; a network with a sharper edge is kept at any
 * length. LEAST_EDGES: of a chain on a scan; chains of noise are shorter. */
static const double least_length = 4, surely_bent = 1;
enum { LEAST_EDGES = 16 };

static bool is_ignored(const patches_build *k, feature_groups *g, uint32_t c, bool is_scan)
{
    const uint32_t network = sets_root(g->network, c), chain = sets_root(g->chain, c);
    const double shortest = least_length * k->params->spacing;
    return (g->network_length[network] < shortest && !(g->network_angle[network] > surely_bent)) ||
           (is_scan && (g->chain_edges[chain] < LEAST_EDGES || g->chain_length[chain] < shortest));
}

/* Sharp edges caused by noise or decimation, or within a small region, are not feature edges. */
static bool discard_features(patches_build *k, bool is_scan, mesh_notes *notes, error *e)
{
    feature_groups g = {0};
    size_t dropped = 0;
    const bool ok = make_groups(k, &g, e);
    if (ok) {
        list_bent(k, &g);
        measure_groups(k, &g);
    }
    for (uint32_t c = 0; ok && c < g.count; c++) {
        const bent_edge *b = &g.edge[c];
        if (mesh_edges_width(k->edges, b->end[0], b->at) != 2 || !is_ignored(k, &g, c, is_scan)) continue;
        k->is_cut[b->at] = false;
        dropped++;
    }
    free_groups(&g);
    k->cut_count -= dropped;
    if (dropped > 0)
        mesh_note(notes, "%zu sharp edges form short chains only; they are not feature edges", dropped);
    return ok;
}

/* Marks the edges at which patches end. */
static void mark_cuts(patches_build *k, double angle)
{
    const uint32_t *kind = k->params->kind;
    for (uint32_t v = 0; v < k->m->vertex_count; v++)
        for (size_t i = k->edges->first[v], n; i < k->edges->first[v + 1]; i += n) {
            const mesh_side *s = k->edges->sides + i;
            n = mesh_edges_width(k->edges, v, i);
            const bool feature = n == 2 && angle > 0 && is_bent(k, s, angle);
            k->is_cut[i] = n != 2 || feature || (kind && kind[s[0].triangle] != kind[s[1].triangle]);
            k->cut_count += k->is_cut[i];
        }
}

/* Marks the edges at which patches end, and joins triangles at the others. */
static bool cut_edges(patches_build *k, mesh_notes *notes, error *e)
{
    bool is_scan;
    mesh_patches *out = k->out;
    k->is_cut = mem_array(3 * k->m->triangle_count, sizeof *k->is_cut, what, e);
    if (!k->is_cut || !find_normals(k, e) || !orientation_init(&k->turned, k->m->triangle_count, e))
        return false;
    out->feature_angle = find_angle(k, &is_scan);
    out->closed = true;
    if (!threads_may_go_on(k->params->pool, e)) return false;
    mark_cuts(k, out->feature_angle);
    if (!threads_may_go_on(k->params->pool, e)) return false;
    if (!k->params->kind && out->feature_angle > 0 && !discard_features(k, is_scan, notes, e)) return false;
    for (uint32_t v = 0; v < k->m->vertex_count; v++)
        for (size_t i = k->edges->first[v], n; i < k->edges->first[v + 1]; i += n) {
            const mesh_side *s = k->edges->sides + i;
            n = mesh_edges_width(k->edges, v, i);
            out->open_edges += n == 1;
            out->feature_edges += n == 2 && k->is_cut[i] && !k->params->kind;
            out->nonmanifold_edges += n > 2;
            out->closed &= n % 2 == 0 || k->was_closed;
            if (!k->is_cut[i])
                orientation_join(&k->turned, s[0].triangle, s[1].triangle, s[0].upwards == s[1].upwards);
        }
    return true;
}

/* ---- patches */

static bool number_patches(patches_build *k, error *e)
{
    mesh_patches *out = k->out;
    const size_t triangles = k->m->triangle_count;
    bool turned;
    k->patch = mem_array(triangles, sizeof *k->patch, what, e);
    if (!k->patch) return false;
    for (uint32_t n = 0; n < triangles; n++) /* a root is the least of its set, so it comes first */
        k->patch[n] = orientation_find(&k->turned, n, &turned) == n ? (uint32_t)out->count++ : UINT32_MAX;
    for (uint32_t n = 0; n < triangles; n++)
        if (k->patch[n] == UINT32_MAX) k->patch[n] = k->patch[orientation_find(&k->turned, n, &turned)];
    if (!threads_may_go_on(k->params->pool, e)) return false;
    out->first = mem_array(out->count + 1, sizeof *out->first, what, e);
    out->one_sided = mem_array(out->count, sizeof *out->one_sided, what, e);
    out->reversed = mem_array(out->count, sizeof *out->reversed, what, e);
    if (k->params->kind) out->kind = mem_array(out->count, sizeof *out->kind, what, e);
    size_t *minority = mem_array(out->count, sizeof *minority, what, e);
    bool ok = out->first && out->one_sided && out->reversed && minority && (out->kind || !k->params->kind);
    for (uint32_t n = 0; ok && n < triangles; n++) {
        uint32_t root = orientation_find(&k->turned, n, &turned), p = k->patch[n];
        out->first[p + 1]++;
        minority[p] += turned;
        if (out->kind) out->kind[p] = k->params->kind[n];
        out->one_sided[p] = k->turned.conflict[root];
    }
    for (uint32_t n = 0; ok && n < triangles; n++) { /* the majority of a patch keeps its orientation */
        uint32_t p = k->patch[n];
        orientation_find(&k->turned, n, &turned);
        if (out->one_sided[p] || turned != (2 * minority[p] <= out->first[p + 1])) continue;
        uint32_t *t = k->m->triangle[n], swap = t[1];
        t[1] = t[2];
        t[2] = swap;
        out->reversed[p]++;
    }
    free(minority);
    for (size_t p = 0; ok && p < out->count; p++) out->first[p + 1] += out->first[p];
    return ok;
}

/* ---- curves */

static bool list_cuts(patches_build *k, error *e)
{
    k->cuts = mem_array(k->cut_count, sizeof *k->cuts, what, e);
    k->patches = mem_array(3 * k->m->triangle_count, sizeof *k->patches, what, e);
    k->at = mem_array(k->m->vertex_count + 2, sizeof *k->at, what, e);
    k->around = mem_array(2 * k->cut_count, sizeof *k->around, what, e);
    k->corner = mem_array(k->m->vertex_count, sizeof *k->corner, what, e);
    if (!k->cuts || !k->patches || !k->at || !k->around || !k->corner) return false;
    size_t count = 0, used = 0;
    for (uint32_t v = 0; v < k->m->vertex_count; v++)
        for (size_t i = k->edges->first[v], n; i < k->edges->first[v + 1]; i += n) {
            n = mesh_edges_width(k->edges, v, i);
            if (!k->is_cut[i]) continue;
            const mesh_side *s = k->edges->sides + i;
            for (size_t side = 0; side < n; side++) k->patches[used + side] = k->patch[s[side].triangle];
            qsort(k->patches + used, n, sizeof *k->patches, compare_uint32);
            k->cuts[count++] = (cut){v, s->other, used, n, n == 2 ? elementary_cos(angle_at(k, s)) : 0};
            used += n;
            k->at[v + 2]++;
            k->at[s->other + 2]++;
        }
    for (size_t v = 2; v < k->m->vertex_count + 2; v++) k->at[v] += k->at[v - 1];
    for (uint32_t c = 0; c < count; c++) {
        k->around[k->at[k->cuts[c].from + 1]++] = c;
        k->around[k->at[k->cuts[c].to + 1]++] = c;
    }
    return true;
}

static size_t cuts_at(const patches_build *k, uint32_t v)
{
    return k->at[v + 1] - k->at[v];
}

static uint32_t far_end(const cut *c, uint32_t v)
{
    return c->from == v ? c->to : c->from;
}

/* The angle between the two cuts at v, radians. */
static double bend_at(const patches_build *k, uint32_t v)
{
    const cut *one = &k->cuts[k->around[k->at[v]]], *other = &k->cuts[k->around[k->at[v] + 1]];
    return bend_at_vertex(k->m, far_end(one, v), v, far_end(other, v));
}

/* Whether one curve continues through v. */
static bool goes_on(const patches_build *k, uint32_t v)
{
    if (cuts_at(k, v) != 2) return false;
    const cut *a = &k->cuts[k->around[k->at[v]]], *b = &k->cuts[k->around[k->at[v] + 1]];
    return a->patch_count == b->patch_count &&
           memcmp(k->patches + a->patch_first, k->patches + b->patch_first,
                  a->patch_count * sizeof *k->patches) == 0 &&
           (k->bend == 0 || bend_at(k, v) <= k->bend);
}

static void find_corners(patches_build *k)
{
    bends all = {0};
    for (uint32_t v = 0; v < k->m->vertex_count; v++) {
        if (cuts_at(k, v) != 2) continue;
        const cut *a = &k->cuts[k->around[k->at[v]]], *b = &k->cuts[k->around[k->at[v] + 1]];
        bends_add(&all, bend_at(k, v),
                  0.5 * (length_of(k->m, a->from, a->to) + length_of(k->m, b->from, b->to)));
    }
    const double angle = k->out->feature_angle;
    k->bend = angle > 0 && !k->out->closed ? feature_angle(k, &all) : angle;
    for (uint32_t v = 0; v < k->m->vertex_count; v++) {
        k->corner[v] = cuts_at(k, v) > 0 && !goes_on(k, v);
        k->out->corner_count += k->corner[v];
    }
}

/* Adds the curve that begins at `start` with cut `c` and ends at the next corner, or closes. */
static void follow(patches_build *k, uint32_t start, uint32_t c, bool *done)
{
    mesh_patches *out = k->out;
    field_curve *curve = &out->curve[out->curve_count];
    const cut *begin = &k->cuts[c];
    size_t last = out->curve_count ? curve[-1].first + curve[-1].count : 0;
    *curve = (field_curve){.first = last, .patch_count = begin->patch_count};
    curve->patch_first = out->curve_count ? curve[-1].patch_first + curve[-1].patch_count : 0;
    memcpy(out->curve_patch + curve->patch_first, k->patches + begin->patch_first,
           begin->patch_count * sizeof *k->patches);
    uint32_t v = start;
    out->vertex[last + curve->count++] = k->m->vertex[v];
    for (;;) {
        done[c] = true;
        curve->cosine = fmin(curve->cosine, k->cuts[c].cosine);
        v = far_end(&k->cuts[c], v);
        curve->closed = v == start && !k->corner[v];
        if (!curve->closed) out->vertex[last + curve->count++] = k->m->vertex[v];
        if (k->corner[v] || curve->closed) break;
        c = k->around[k->at[v] + (k->around[k->at[v]] == c)];
    }
    out->curve_count++;
}

static bool make_curves(patches_build *k, error *e)
{
    mesh_patches *out = k->out;
    if (!list_cuts(k, e)) return false;
    if (!threads_may_go_on(k->params->pool, e)) return false;
    find_corners(k);
    bool *done = mem_array(k->cut_count, sizeof *done, what, e);
    out->curve = mem_array(k->cut_count, sizeof *out->curve, what, e);
    out->vertex = mem_array(2 * k->cut_count, sizeof *out->vertex, what, e);
    out->curve_patch = mem_array(3 * k->m->triangle_count, sizeof *out->curve_patch, what, e);
    bool ok = done && out->curve && out->vertex && out->curve_patch;
    for (int loops = 0; ok && loops < 2; loops++) /* first the curves between corners */
        for (uint32_t v = 0; v < k->m->vertex_count; v++)
            for (size_t i = k->at[v]; (loops || k->corner[v]) && i < k->at[v + 1]; i++)
                if (!done[k->around[i]]) follow(k, v, k->around[i], done);
    free(done);
    return ok;
}

/* ---- the mesh of patches */

/* The number of the triangle's corner at v. */
static uint32_t corner_at(const mesh *m, uint32_t triangle, uint32_t v)
{
    const uint32_t *t = m->triangle[triangle];
    return 3 * triangle + (t[0] == v ? 0 : t[1] == v ? 1 : 2);
}

/* The edges within patches: joins the corners that share a vertex. Cut edges: marks their corners. */
static void sort_corners(patches_build *k, uint32_t *set, bool *on_cut)
{
    const mesh *m = k->m;
    sets_reset(set, 3 * m->triangle_count);
    for (uint32_t v = 0; v < m->vertex_count && !threads_stopped(k->params->pool); v++)
        for (size_t i = k->edges->first[v], n; i < k->edges->first[v + 1]; i += n) {
            const mesh_side *s = k->edges->sides + i;
            n = mesh_edges_width(k->edges, v, i);
            for (size_t side = 0; k->is_cut[i] && side < n; side++)
                on_cut[corner_at(m, s[side].triangle, v)] = on_cut[corner_at(m, s[side].triangle, s->other)] =
                    true;
            if (k->is_cut[i]) continue;
            sets_join(set, corner_at(m, s[0].triangle, v), corner_at(m, s[1].triangle, v));
            sets_join(set, corner_at(m, s[0].triangle, s->other), corner_at(m, s[1].triangle, s->other));
            k->out->euler[k->patch[s->triangle]]--;
        }
}

/* Assigns vertices: corners of triangles that are connected by edges that are not cut share one. */
static bool part_vertices(patches_build *k, error *e)
{
    const mesh *m = k->m;
    mesh_patches *out = k->out;
    size_t *to = mem_array(out->count, sizeof *to, what, e);
    uint32_t *set = mem_array(3 * m->triangle_count, sizeof *set, what, e);
    bool *on_cut = mem_array(3 * m->triangle_count, sizeof *on_cut, what, e);
    out->m.vertex = mem_array(3 * m->triangle_count, sizeof *out->m.vertex, what, e);
    out->m.triangle = mem_array(m->triangle_count, sizeof *out->m.triangle, what, e);
    out->euler = mem_array(out->count, sizeof *out->euler, what, e);
    bool ok = to && set && on_cut && out->m.vertex && out->m.triangle && out->euler;
    if (ok) sort_corners(k, set, on_cut);
    out->m.triangle_count = m->triangle_count;
    for (size_t p = 0; ok && p < out->count; p++) to[p] = out->first[p];
    ok = ok && threads_may_go_on(k->params->pool, e);
    for (uint32_t c = 0; ok && c < 3 * m->triangle_count; c++) {
        set[c] = sets_root(set, c);
        on_cut[set[c]] |= on_cut[c];
    }
    ok = ok && threads_may_go_on(k->params->pool, e);
    for (uint32_t c = 0; ok && c < 3 * m->triangle_count; c++) {
        const uint32_t patch = k->patch[c / 3];
        out->euler[patch] += (set[c] == c && !on_cut[c]) + (c % 3 == 2); /* a vertex; a triangle */
        if (set[c] == c) {
            out->m.vertex[out->m.vertex_count] = m->vertex[m->triangle[c / 3][c % 3]];
            set[c] = (uint32_t)out->m.vertex_count++;
        } else {
            set[c] = set[set[c]]; /* a root is the least of its set, so it is numbered already */
        }
        out->m.triangle[to[patch]][c % 3] = set[c];
        if (c % 3 == 2) to[patch]++;
    }
    free(to);
    free(set);
    free(on_cut);
    return ok;
}

/* ---- the whole */

/* Removes coplanar overlaps of faces. *edges: the edges of the mesh, updated. */
static bool cut_coplanar(patches_build *k, const mesh_edges **edges, mesh_notes *notes, error *e)
{
    mesh *m = k->m;
    const rounding r = rounding_of(m, k->params->pool);
    const bool open = (*edges)->open > 0 || (*edges)->odd > 0;
    coplanar_overlap over;
    if (!coplanar_cut(m, *edges, &r, k->params->pool, &over, e)) return false;
    if (over.unfinished)
        mesh_note(
            notes,
            "faces overlap in one plane and could not be cut apart: points may be close there. Join the faces in "
            "the file.");
    if (m->welded) return true;
    if (over.same > 0)
        mesh_note(
            notes,
            "faces overlap in one plane: an area of %.4g lies in two faces that look the same way. It is sampled once; "
            "join the faces to have it in one.",
            over.same);
    if (over.opposite > 0)
        mesh_note(
            notes,
            "faces touch in one plane: an area of %.4g lies in two faces that look opposite ways. It is sampled once; move the "
            "faces apart to sample both.",
            over.opposite);
    if (over.contact > 0)
        mesh_note(
            notes,
            "faces touch in one plane: an area of %.4g lies in two faces that look opposite ways. It has no points, as "
            "neither bounds the solid; move the faces apart to sample both.",
            over.contact);
    *edges = &k->listed_edges;
    k->was_closed = !open;
    const rounding thin = {COPLANAR_THIN * r.absolute, COPLANAR_THIN * r.relative};
    return flat_triangles_remove_thin(m, &thin, e) && mesh_weld(m, MESH_DROP_IF_CLOSED, notes, e) &&
           mesh_edges_list(m, k->params->pool, &k->listed_edges, e);
}

static bool weld(patches_build *k, mesh_notes *notes, error *e)
{
    mesh *m = k->m;
    const mesh_edges *edges = k->params->edges ? k->params->edges : &k->listed_edges;
    if (!mesh_weld(m, MESH_DROP_IF_CLOSED, notes, e)) return false;
    if (m->triangle_count == 0)
        return error_set(e, ERROR_NO_SURFACE,
                         "all triangles of the mesh have an area of 0: correct the file");
    if (!k->params->edges && !mesh_edges_list(m, k->params->pool, &k->listed_edges, e)) return false;
    if (!cut_coplanar(k, &edges, notes, e)) return false;
    k->edges = mesh_edges_close_seams(m, edges, k->params->weld * bbox_longest(mesh_box(m, k->params->pool)),
                                      k->params->pool, &k->listed_edges, notes, e);
    if (!k->edges || m->welded) return k->edges;
    k->edges = &k->listed_edges; /* faces may coincide now */
    return mesh_weld(m, MESH_KEEP_CANCELLED, notes, e) &&
           mesh_edges_list(m, k->params->pool, &k->listed_edges, e);
}

/* A mesh with kinds is complete: it is not welded. */
static bool list_edges(patches_build *k, mesh_notes *notes, error *e)
{
    if (!k->params->kind) return weld(k, notes, e);
    k->edges = &k->listed_edges;
    return mesh_edges_list(k->m, k->params->pool, &k->listed_edges, e);
}

/* Frees what is not needed after the curves are made. */
static void free_curve_scratch(patches_build *k)
{
    orientation_free(&k->turned);
    free(k->normal);
    free(k->cuts);
    free(k->patches);
    free(k->at);
    free(k->around);
    free(k->corner);
    k->normal = NULL;
    k->cuts = NULL;
    k->patches = k->around = NULL;
    k->at = NULL;
    k->corner = NULL;
}

static bool make(patches_build *k, mesh_notes *notes, error *e)
{
    if (!list_edges(k, notes, e) || !cut_edges(k, notes, e) || !threads_may_go_on(k->params->pool, e))
        return false;
    if (!number_patches(k, e) || !threads_may_go_on(k->params->pool, e) || !make_curves(k, e)) return false;
    free_curve_scratch(k);
    return threads_may_go_on(k->params->pool, e) && part_vertices(k, e);
}

bool mesh_patches_make(mesh *m, const mesh_patches_params *params, mesh_notes *notes, mesh_patches *out,
                       error *e)
{
    mesh_patches made = {0};
    patches_build k = {.m = m, .params = params, .out = &made};
    bool ok = make(&k, notes, e);
    mesh_edges_free(&k.listed_edges);
    free_curve_scratch(&k);
    free(k.is_cut);
    free(k.patch);
    mesh_free(m);
    if (ok)
        *out = made;
    else
        mesh_patches_free(&made);
    return ok;
}

void mesh_patches_free(mesh_patches *p)
{
    mesh_free(&p->m);
    mesh_free(&p->uncut);
    free(p->first);
    free(p->one_sided);
    free(p->reversed);
    free(p->kind);
    free(p->euler);
    free(p->curve);
    free(p->vertex);
    free(p->curve_patch);
    *p = (mesh_patches){0};
}
