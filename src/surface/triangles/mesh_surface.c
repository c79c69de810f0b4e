// SPDX-License-Identifier: Apache-2.0
#include "surface/triangles/mesh_surface.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/isa.h"
#include "base/core/memory.h"
#include "geometry/space/smooth_triangle.h"
#include "geometry/mesh/mesh_edges.h"
#include "surface/triangles/mesh_place.h"
#include "surface/triangles/triangle_tree.h"
#include "surface/triangles/mesh_refinement.h"
#include "geometry/space/triangle.h"

static const char what[] = "the surface of the mesh";

/* Tolerance for places at the end of a patch, over the extent of the mesh. */
static const double rounding = 1e-7;
/* A place above a triangle within this distance, over the extent, is on it: another triangle cannot be
 * closer by more than this. */
static const double touching = 1e-6;
/* Minimum height of a triangle over its longest edge for the shape operator. The gradient of the normal
 * over a thinner triangle is meaningless. */
static const double least_height = 1e-3;
/* MOST_STEPS: maximum number of triangles that a walk crosses before the tree is searched. MOST_IN_FAN: maximum
 * number of triangles around a corner that it tries in each direction. */
enum { MOST_STEPS = 24, MOST_IN_FAN = 16 };
/* Maximum distance of a place from the triangle at which its walk ends, over the square root of twice the
 * area. A place farther away may be closer to triangles that are not adjacent. Smaller: more searches of the
 * tree (0.5: 8 % more time on dense scans). */
static const double FARTHEST_OVER_SIZE = 1;

/* MOST_ROUNDS: of refinement, each halves long sides once. REFINED_BYTES: peak memory per triangle during
 * refinement, approximate. */
enum { MOST_ROUNDS = 32, REFINED_BYTES = 400 };

/* Radius of the disc over which shape operators are averaged, in spacings, and the largest number of
 * rounds, which bounds the time. */
static const double SMOOTHED_OVER = 0.5;
enum { MOST_SMOOTHING = 16 };

#define NO_TRIANGLE UINT32_MAX /* the patch ends at this edge */

/* A place of a triangle: the weights of its first two corners; the three weights sum to WHOLE. */
typedef struct corner_weights {
    uint16_t of[2];
} corner_weights;

enum { WHOLE = 1 << 15, BLOCK = 1 << 16, STRIDE = 64 }; /* BLOCK, STRIDE: pieces */

/* A part of a triangle. */
typedef struct piece {
    uint32_t triangle;
    corner_weights corner[3];
} piece;

/* A triangle with several pieces: the number of its first piece, and its index in `pieces`. */
typedef struct divided_triangle {
    uint32_t number, stored;
} divided_triangle;

/* A vertex with its unit normal. They are stored together because they are mostly read together. */
typedef struct surface_vertex {
    vec3 place, normal;
} surface_vertex;

typedef struct patch_field {
    field base;
    const mesh_surface *whole;
    mesh triangles; /* of the patch: a range of the arrays of `whole` */
    size_t first;
    triangle_tree *tree;
} patch_field;

struct mesh_surface {
    field base;
    mesh_patches mesh;
    mesh given;         /* the mesh before refinement; its vertices are the first ones of the refined mesh */
    uint32_t *whole;    /* per triangle: the triangle of `given` that contains it; NULL: itself */
    bool has_one_sided; /* a patch is one-sided */
    field_patches patches;
    patch_field *patch;
    triangle_forest *trees; /* those of the patches */
    surface_vertex *at;     /* per vertex */
    sym3 *shape;            /* per vertex: the shape operator, symmetric and tangential; or NULL: dropped */
    bool *at_end;           /* per vertex: the patch ends there */
    uint32_t (*beside)[3]; /* per triangle: the triangle that shares the edge from corner k, or NO_TRIANGLE */
    size_t cell_count; /* pieces of all triangles, in their order; an undivided triangle is a piece itself */
    /* pieces of the divided triangles, in blocks: reallocating one array would need the memory twice */
    piece **pieces;
    size_t piece_count, block_room; /* piece_count: of `pieces` */
    divided_triangle *divided;
    size_t divided_count, divided_room;
    /* of every STRIDE-th piece: the number of divided triangles that begin before it */
    uint32_t *divided_before;
};

static piece whole_triangle(size_t n)
{
    return (piece){(uint32_t)n, {{{WHOLE, 0}}, {{0, WHOLE}}, {{0, 0}}}};
}

static piece *cut_piece_at(const mesh_surface *s, size_t k)
{
    return &s->pieces[k / BLOCK][k % BLOCK];
}

static piece piece_at(const mesh_surface *s, size_t k)
{
    size_t next = s->divided_before[k / STRIDE];
    while (next < s->divided_count && s->divided[next].number <= k) next++;
    if (next == 0) return whole_triangle(k);
    const divided_triangle *last = &s->divided[next - 1];
    const size_t end = next < s->divided_count ? s->divided[next].stored : s->piece_count,
                 at = last->stored + (k - last->number);
    return at < end ? *cut_piece_at(s, at)
                    : whole_triangle(cut_piece_at(s, last->stored)->triangle + 1 + at - end);
}

/* The patch of triangle n: the last that begins at or before it. */
static size_t patch_of(const mesh_surface *s, size_t n)
{
    size_t low = 0, high = s->mesh.count - 1;
    while (low < high) {
        size_t middle = low + (high - low + 1) / 2;
        if (s->mesh.first[middle] <= n)
            low = middle;
        else
            high = middle - 1;
    }
    return low;
}

static bool is_one_sided(const mesh_surface *s, size_t n)
{
    return s->has_one_sided && s->mesh.one_sided[patch_of(s, n)];
}

/* ---- normals and shape operators */

/* The angle of a triangle at its corner k. */
static double angle_at(const mesh_surface *s, size_t n, int k)
{
    const uint32_t *t = s->mesh.m.triangle[n];
    const vec3 *v = s->mesh.m.vertex, a = vec3_sub(v[t[(k + 1) % 3]], v[t[k]]),
               b = vec3_sub(v[t[(k + 2) % 3]], v[t[k]]);
    return elementary_atan2(vec3_norm(vec3_cross(a, b)), vec3_dot(a, b));
}

/* Vertex normals: means of the normals of the incident triangles, weighted by angle. On a one-sided patch
 * they are turned to the side of the first. */
static bool find_normals(const mesh_surface *s, const threads *pool, vec3 *normal, error *e)
{
    const mesh_patches *m = &s->mesh;
    for (size_t p = 0; p < m->count; p++)
        for (size_t n = m->first[p]; n < m->first[p + 1] && !threads_stopped(pool); n++) {
            const vec3 unit = vec3_unit(mesh_across(&s->mesh.m, n));
            const double a = angle_at(s, n, 0), b = angle_at(s, n, 1),
                         angle[3] = {a, b, fmax(M_PI - a - b, 0)};
            for (int k = 0; k < 3; k++) {
                vec3 *sum = &normal[m->m.triangle[n][k]];
                *sum = vec3_axpy(angle[k], m->one_sided[p] ? smooth_triangle_turn(unit, *sum) : unit, *sum);
            }
        }
    for (size_t v = 0; v < m->m.vertex_count; v++) normal[v] = vec3_unit(normal[v]);
    return threads_may_go_on(pool, e);
}

static sym3 sym3_axpy(double a, sym3 m, sym3 to)
{
    return (sym3){to.xx + a * m.xx, to.yy + a * m.yy, to.zz + a * m.zz,
                  to.xy + a * m.xy, to.xz + a * m.xz, to.yz + a * m.yz};
}

/* P m P, with P = I - n n'. */
static sym3 in_plane(sym3 m, vec3 n)
{
    const vec3 mn = sym3_apply(m, n);
    const double nmn = vec3_dot(n, mn);
    return (sym3){
        m.xx - 2 * n.x * mn.x + nmn * n.x * n.x,          m.yy - 2 * n.y * mn.y + nmn * n.y * n.y,
        m.zz - 2 * n.z * mn.z + nmn * n.z * n.z,          m.xy - n.x * mn.y - n.y * mn.x + nmn * n.x * n.y,
        m.xz - n.x * mn.z - n.z * mn.x + nmn * n.x * n.z, m.yz - n.y * mn.z - n.z * mn.y + nmn * n.y * n.z};
}

/* The symmetric part of the gradient of the interpolated normal over a triangle. */
static sym3 normal_gradient(const mesh_surface *s, size_t n, vec3 cross)
{
    const uint32_t *t = s->mesh.m.triangle[n];
    const vec3 *v = s->mesh.m.vertex;
    sym3 sum = {0};
    for (int k = 0; k < 3; k++) { /* the weight of corner k grows across the opposite side */
        const vec3 side = vec3_sub(v[t[(k + 2) % 3]], v[t[(k + 1) % 3]]),
                   g = vec3_scale(vec3_cross(cross, side), 1 / vec3_norm2(cross)), own = s->at[t[k]].normal,
                   a = is_one_sided(s, n) ? smooth_triangle_turn(own, cross) : own;
        sum = sym3_axpy(1,
                        (sym3){a.x * g.x, a.y * g.y, a.z * g.z, 0.5 * (a.x * g.y + a.y * g.x),
                               0.5 * (a.x * g.z + a.z * g.x), 0.5 * (a.y * g.z + a.z * g.y)},
                        sum);
    }
    return sum;
}

/* Shape operators of the vertices: means over the incident triangles, weighted by area. On a one-sided
 * patch the sign is that of the vertex normal. */
static bool find_shapes(mesh_surface *s, const threads *pool, error *e)
{
    const mesh *m = &s->mesh.m;
    double *weight = mem_array(m->vertex_count, sizeof *weight, what, e);
    if (!weight) return false;
    for (size_t n = 0; n < m->triangle_count && !threads_stopped(pool); n++) {
        const uint32_t *t = m->triangle[n];
        const vec3 cross = mesh_across(&s->mesh.m, n);
        double longest2 = 0, area = vec3_norm(cross);
        for (int k = 0; k < 3; k++)
            longest2 = fmax(longest2, vec3_norm2(vec3_sub(m->vertex[t[k]], m->vertex[t[(k + 1) % 3]])));
        if (!(area > least_height * longest2)) continue;
        const sym3 turn = normal_gradient(s, n, cross);
        for (int k = 0; k < 3; k++) {
            const bool opposite = is_one_sided(s, n) && vec3_dot(s->at[t[k]].normal, cross) < 0;
            const double side = opposite ? -area : area;
            s->shape[t[k]] = sym3_axpy(side, turn, s->shape[t[k]]);
            weight[t[k]] += area;
        }
    }
    for (size_t v = 0; v < m->vertex_count; v++)
        if (weight[v] > 0)
            s->shape[v] = in_plane(sym3_axpy(1 / weight[v], s->shape[v], (sym3){0}), s->at[v].normal);
    free(weight);
    return threads_may_go_on(pool, e);
}

/* Averages each vertex's shape operator over a disc of radius SMOOTHED_OVER spacings, approximately: the
 * triangles of a scan are smaller than the spacing, and noisy. Skips one-sided patches, where signs may
 * differ. */
static bool smooth_shapes(mesh_surface *s, double longest, threads *pool, error *e)
{
    const mesh *m = &s->mesh.m;
    const double side = sqrt(mesh_area(m) / fmax((double)m->triangle_count, 1)), /* of a triangle, about */
        reach = SMOOTHED_OVER * longest / side;
    const int rounds = (int)fmin(reach * reach, MOST_SMOOTHING);
    sym3 *sum = rounds > 0 ? mem_array(m->vertex_count, sizeof *sum, what, e) : NULL;
    double *weight = rounds > 0 ? mem_array(m->vertex_count, sizeof *weight, what, e) : NULL;
    const bool ok = rounds == 0 || (sum && weight);
    for (int round = 0; ok && round < rounds && !threads_stopped(pool); round++) {
        for (size_t v = 0; v < m->vertex_count; v++) {
            sum[v] = s->shape[v];
            weight[v] = 1;
        }
        for (size_t n = 0; n < m->triangle_count && !threads_stopped(pool); n++)
            for (int k = 0; k < 3 && !is_one_sided(s, n); k++)
                for (int other = 1; other < 3; other++) {
                    const uint32_t to = m->triangle[n][k], from = m->triangle[n][(k + other) % 3];
                    sum[to] = sym3_axpy(0.5, s->shape[from], sum[to]); /* a side has two triangles */
                    weight[to] += 0.5;
                }
        for (size_t v = 0; v < m->vertex_count; v++)
            s->shape[v] = in_plane(sym3_axpy(1 / weight[v], sum[v], (sym3){0}), s->at[v].normal);
    }
    free(sum);
    free(weight);
    return ok && threads_may_go_on(pool, e);
}

/* Sets `beside` and `at_end`. Vertices are shared within a patch only, so that a patch ends at edges of
 * one triangle. */
static bool find_sides(mesh_surface *s, threads *pool, error *e)
{
    mesh_edges edges = {0};
    const bool ok = mesh_edges_list(&s->mesh.m, pool, &edges, e);
    for (uint32_t v = 0; ok && v < edges.vertex_count; v++)
        for (size_t i = edges.first[v], n; i < edges.first[v + 1]; i += n) {
            n = mesh_edges_width(&edges, v, i);
            const mesh_side *side = edges.sides + i;
            for (size_t j = 0; j < n; j++) {
                const uint32_t from = side[j].upwards ? v : side[j].other,
                               *t = s->mesh.m.triangle[side[j].triangle];
                const int k = t[0] == from ? 0 : t[1] == from ? 1 : 2;
                s->beside[side[j].triangle][k] = n == 2 ? side[1 - j].triangle : NO_TRIANGLE;
            }
            if (n == 1) s->at_end[v] = s->at_end[side->other] = true;
        }
    mesh_edges_free(&edges);
    return ok;
}

/* ---- sampling */

/* The place of a triangle that is closest to x. */
typedef struct closest_point {
    vec3 off;    /* x minus the place */
    vec3 normal; /* interpolated normal at the place, unit */
    vec3 own;    /* normal of the triangle, unit; without area: `normal` */
    bool inside; /* the place is inside the triangle, not on an edge */
    bool at_end; /* the place is on an edge where the patch ends, or at a corner of one */
} closest_point;

/* On a one-sided patch, vertex normals are turned to the side of the triangle's normal. */
static smooth_triangle triangle_at(const mesh_surface *s, size_t n)
{
    const uint32_t *t = s->mesh.m.triangle[n];
    const surface_vertex *a = &s->at[t[0]], *b = &s->at[t[1]], *c = &s->at[t[2]];
    smooth_triangle out = {{a->place, b->place, c->place}, {a->normal, b->normal, c->normal}};
    if (!is_one_sided(s, n)) return out;
    const vec3 own = smooth_triangle_own_normal(&out);
    for (int k = 0; k < 3; k++) out.normal[k] = smooth_triangle_turn(out.normal[k], own);
    return out;
}

static closest_point closest_point_on(const mesh_surface *s, size_t n, const double weight[3], vec3 x)
{
    const smooth_triangle on = triangle_at(s, n);
    const vec3 own = smooth_triangle_own_normal(&on);
    vec3 normal;
    const vec3 off = smooth_triangle_offset(&on, weight, x, &normal);
    int zeros = 0;
    for (int k = 0; k < 3; k++) zeros += weight[k] == 0;
    normal = vec3_norm2(normal) > 0 ? vec3_unit(normal) : vec3_norm2(own) > 0 ? own : vec3_make(0, 0, 1);
    closest_point out = {off, normal, vec3_norm2(own) > 0 ? own : normal, zeros == 0, false};
    for (int k = 0; zeros > 0 && k < 3;
         k++) /* the edge opposite to the corner of weight 0, or the only corner */
        out.at_end |= zeros == 1 ? weight[k] == 0 && s->beside[n][(k + 1) % 3] == NO_TRIANGLE
                                 : weight[k] > 0 && s->at_end[s->mesh.m.triangle[n][k]];
    return out;
}

/* F: the distance along the interpolated normal; at an edge, clamped between the planes of both triangles. */
static double distance_along(const closest_point *f)
{
    const double up = vec3_dot(f->off, f->normal), far = vec3_norm(f->off);
    if (f->inside || f->at_end) return smooth_triangle_distance(f->off, f->normal, f->own);
    const double most = far / SMOOTH_TRIANGLE_MIN_COSINE;
    return up == 0 ? 0 : fmax(fmin(far * far / up, most), -most);
}

static triangle corners_of(const mesh_surface *s, size_t n)
{
    const uint32_t *t = s->mesh.m.triangle[n];
    return (triangle){s->at[t[0]].place, s->at[t[1]].place, s->at[t[2]].place};
}

/* The nearest triangle to x that a walk has found. */
typedef struct descent {
    const mesh_surface *surface;
    vec3 x;
    uint32_t nearest;
    double distance2; /* squared distance of x from it */
} descent;

/* Replaces the nearest triangle by n if that is closer to x. */
static void try_triangle(descent *d, uint32_t n)
{
    if (n == NO_TRIANGLE || n == d->nearest) return;
    const triangle t = corners_of(d->surface, n);
    const double distance2 = triangle_distance2(&t, d->x);
    if (!(distance2 < d->distance2)) return;
    d->distance2 = distance2;
    d->nearest = n;
}

/* Tries the triangles around corner k of triangle n, starting across the side from corner k if `ahead`,
 * otherwise across the side to it. Returns whether they surround the corner. */
static bool try_fan_from(descent *d, uint32_t n, int k, bool ahead)
{
    const mesh_surface *s = d->surface;
    const uint32_t first = n, corner = s->mesh.m.triangle[n][k];
    int side = ahead ? k : (k + 2) % 3;
    uint32_t other = s->mesh.m.triangle[n][(k + (ahead ? 1 : 2)) % 3]; /* the side's other end */
    for (int step = 0; step < MOST_IN_FAN; step++) {
        n = s->beside[n][side];
        if (n == first || n == NO_TRIANGLE) return n == first;
        try_triangle(d, n);
        const uint32_t *t = s->mesh.m.triangle[n];
        const int at = t[0] == corner ? 0 : t[1] == corner ? 1 : 2;
        const bool is_turned = t[(at + 1) % 3] == other; /* adjacent triangles may differ in orientation */
        side = is_turned ? (at + 2) % 3 : at;
        other = t[(at + (is_turned ? 2 : 1)) % 3];
    }
    return true;
}

/* Tries the triangles beyond the sides of triangle n that x is near, each opposite to a corner in `near`. If
 * none is closer and x is near two sides, tries all triangles around their common corner. */
static void try_beyond(descent *d, uint32_t n, const bool near[3])
{
    for (int k = 0; k < 3; k++)
        if (near[k]) try_triangle(d, d->surface->beside[n][(k + 1) % 3]);
    for (int k = 0; k < 3 && d->nearest == n; k++)
        if (near[(k + 1) % 3] && near[(k + 2) % 3] && !try_fan_from(d, n, k, true))
            try_fan_from(d, n, k, false);
}

/* One step of a walk at triangle d->nearest: replaces it by an adjacent triangle that is closer to x. `weight`:
 * barycentric weights of the closest point of the old triangle. Returns the largest squared distance at which
 * the walk may end there. */
static double step_down(descent *d, double weight[3])
{
    const uint32_t n = d->nearest;
    const triangle t = corners_of(d->surface, n);
    const smooth_triangle flat = {.corner = {t.a, t.b, t.c}};
    const vec3 ab = vec3_sub(t.b, t.a), bc = vec3_sub(t.c, t.b), ca = vec3_sub(t.a, t.c),
               cross = vec3_cross(ab, bc);
    const double cross2 = vec3_norm2(cross), up = vec3_dot(vec3_sub(d->x, t.a), cross);
    const vec3 side[3] = {bc, ca, ab};
    bool near[3];
    smooth_triangle_weights(&flat, d->x, weight);
    const bool is_above = weight[0] >= 0 && weight[1] >= 0 && weight[2] >= 0;
    if (!is_above) triangle_weights(&t, d->x, weight);
    for (int k = 0; k < 3; k++)
        near[k] = is_above ? !(smooth_triangle_margin(weight[k], cross2, up, side[k]) > 0) : weight[k] == 0;
    d->distance2 = triangle_distance2(&t, d->x);
    try_beyond(d, n, near);
    return FARTHEST_OVER_SIZE * FARTHEST_OVER_SIZE * sqrt(cross2);
}

/* Walks from triangle *n to a triangle that is closer to x than all adjacent triangles. `weight`: barycentric
 * weights of its closest point. False: undecided; *n is the last triangle of the walk. */
static bool walk(const mesh_surface *s, uint32_t *n, vec3 x, double weight[3])
{
    for (int step = 0; step < MOST_STEPS; step++) {
        const triangle t = corners_of(s, *n);
        const smooth_triangle flat = {.corner = {t.a, t.b, t.c}};
        if (smooth_triangle_weights(&flat, x, weight) > 0) return true;
        descent d = {s, x, *n, INFINITY};
        const double farthest2 = step_down(&d, weight);
        if (d.nearest == *n) return d.distance2 <= farthest2;
        *n = d.nearest;
    }
    return false;
}

static void sample_triangle(const mesh_surface *s, size_t n, const double weight[3], vec3 x,
                            field_order order, field_sample *out)
{
    const closest_point f = closest_point_on(s, n, weight, x);
    out->value = distance_along(&f);
    out->gradient = f.normal;
    if (order != FIELD_HESSIAN) return;
    if (!s->shape) {
        out->hessian = (sym3){0};
        return;
    }
    sym3 shape = {0};
    for (int k = 0; k < 3; k++) {
        const uint32_t v = s->mesh.m.triangle[n][k];
        const bool turned = is_one_sided(s, n) && vec3_dot(s->at[v].normal, f.own) < 0;
        shape = sym3_axpy(turned ? -weight[k] : weight[k], s->shape[v], shape);
    }
    out->hessian = in_plane(shape, f.normal);
}

/* Whether x lies on triangle n within `touching`. `weight`: barycentric weights of its projection. */
static bool touches(const mesh_surface *s, uint32_t n, vec3 x, const double weight[3])
{
    const vec3 cross = mesh_across(&s->mesh.m, n),
               off = vec3_sub(x, s->mesh.m.vertex[s->mesh.m.triangle[n][0]]);
    const double up = vec3_dot(off, cross), near = touching * s->base.extent;
    return fmin(weight[0], fmin(weight[1], weight[2])) > 0 && up * up <= near * near * vec3_norm2(cross);
}

static bool is_of_patch(const patch_field *p, uint32_t hint)
{
    return hint - p->first < p->triangles.triangle_count;
}

/* The closest triangle of the patch, and the barycentric weights of the closest point. Faster if *near is
 * a triangle nearby. */
static uint32_t find_in_patch(const patch_field *p, vec3 x, uint32_t *near, double weight[3])
{
    const size_t n = is_of_patch(p, *near) ? triangle_tree_find_from(p->tree, x, *near - p->first, weight)
                                           : triangle_tree_find(p->tree, x, weight);
    return *near = (uint32_t)(p->first + n);
}

/* find_in_patch; but if x is close to the wall of the hint, the triangle of that wall, even if another
 * wall of the patch is closer. */
static uint32_t nearest_of_patch(const patch_field *p, vec3 x, uint32_t *hint, double weight[3])
{
    if (is_of_patch(p, *hint) && walk(p->whole, hint, x, weight)) return *hint;
    return find_in_patch(p, x, hint, weight);
}

static bool sample_patch_near(const field *f, vec3 x, field_order order, uint32_t *hint, field_sample *out)
{
    const patch_field *p = (const patch_field *)f;
    double weight[3];
    const uint32_t n = nearest_of_patch(p, x, hint, weight);
    sample_triangle(p->whole, n, weight, x, order, out);
    return true;
}

static bool sample_patch(const field *f, vec3 x, field_order order, field_sample *out)
{
    uint32_t hint = FIELD_NO_HINT;
    return sample_patch_near(f, x, order, &hint, out);
}

/* Prefetches the triangles of the hints, then their vertices. (Inlined: the compiler removes calls of a
 * function that only prefetches.) */
ISA_INLINE void prefetch(const mesh_surface *s, const uint32_t hint[VEC3_LANES])
{
    for (int l = 0; l < VEC3_LANES; l++) {
        if (hint[l] >= s->mesh.m.triangle_count) continue;
        __builtin_prefetch(s->mesh.m.triangle[hint[l]]);
        __builtin_prefetch(s->beside[hint[l]]);
    }
    for (int l = 0; l < VEC3_LANES; l++)
        for (int k = 0; k < 3 && hint[l] < s->mesh.m.triangle_count; k++) {
            const uint32_t v = s->mesh.m.triangle[hint[l]][k];
            __builtin_prefetch(&s->at[v].place.x);
            __builtin_prefetch(&s->at[v].normal.z);
        }
}

/* Gathers the triangles of the hints. Lanes that are undefined, without a hint or with one of another patch
 * get a degenerate triangle, above which no place lies. */
static void gather_lanes(const mesh_surface *s, const uint32_t patch[VEC3_LANES],
                         const bool defined[VEC3_LANES], const uint32_t hint[VEC3_LANES], const vec3_lanes *x,
                         smooth_triangle_lanes *out)
{
    out->x = *x;
    for (int l = 0; l < VEC3_LANES; l++) {
        const smooth_triangle t = defined[l] && is_of_patch(&s->patch[patch[l]], hint[l])
                                      ? triangle_at(s, hint[l])
                                      : (smooth_triangle){0};
        for (int k = 0; k < 3; k++) {
            vec3_lanes_put(&out->corner[k], l, t.corner[k]);
            vec3_lanes_put(&out->normal[k], l, t.normal[k]);
        }
    }
}

/* Samples lane l, whose place is not above the triangle of its hint. The search starts from the hint, or else
 * from the triangle of the lane before. Returns the triangle. */
static uint32_t sample_beyond(const mesh_surface *s, const patch_field *p, int l, const vec3_lanes *x,
                              uint32_t hint, uint32_t last, double value[VEC3_LANES], vec3_lanes *gradient)
{
    const vec3 at = vec3_lanes_get(x, l);
    double weight[3];
    field_sample sample;
    const bool has_hint = is_of_patch(p, hint);
    uint32_t n = has_hint ? hint : last;
    if (has_hint)
        nearest_of_patch(p, at, &n, weight);
    else
        find_in_patch(p, at, &n, weight);
    sample_triangle(s, n, weight, at, FIELD_GRADIENT, &sample);
    value[l] = sample.value;
    vec3_lanes_put(gradient, l, sample.gradient);
    return n;
}

static void sample_patch_lanes(const field *f, const uint32_t patch[VEC3_LANES], const vec3_lanes *x,
                               bool defined[VEC3_LANES], uint32_t hint[VEC3_LANES], double value[VEC3_LANES],
                               vec3_lanes *gradient)
{
    const mesh_surface *s = (const mesh_surface *)f;
    uint32_t last = FIELD_NO_HINT; /* the places of the lanes are near each other */
    smooth_triangle_lanes lanes;
    prefetch(s, hint);
    gather_lanes(s, patch, defined, hint, x, &lanes);
    smooth_triangle_find_lanes(&lanes);
    for (int l = 0; l < VEC3_LANES; l++) {
        if (!defined[l]) continue;
        if (lanes.above[l] > 0) {
            value[l] = lanes.value[l];
            vec3_lanes_put(gradient, l, vec3_lanes_get(&lanes.unit, l));
        } else {
            hint[l] = sample_beyond(s, &s->patch[patch[l]], l, x, hint[l], last, value, gradient);
        }
        last = hint[l];
    }
}

static bool is_within(const field *f, vec3 x, uint32_t *hint)
{
    const patch_field *p = (const patch_field *)f;
    double weight[3];
    const uint32_t n = nearest_of_patch(p, x, hint, weight);
    if (weight[0] > 0 && weight[1] > 0 && weight[2] > 0) return true; /* inside the triangle */
    const closest_point at = closest_point_on(p->whole, n, weight, x);
    if (!at.at_end) return true;
    const double up = vec3_dot(at.off, at.own);
    return vec3_norm(vec3_axpy(-up, at.own, at.off)) <= fabs(up) + rounding * f->extent;
}

/* Whether a walk from triangle n to the place x may end on the surface. */
static bool is_close(const mesh_surface *s, uint32_t n, vec3 x)
{
    const triangle t = corners_of(s, n);
    const vec3 cross = vec3_cross(vec3_sub(t.b, t.a), vec3_sub(t.c, t.a));
    return triangle_distance2(&t, x) <= FARTHEST_OVER_SIZE * FARTHEST_OVER_SIZE * vec3_norm(cross);
}

static bool sample_all_near(const field *f, vec3 x, field_order order, uint32_t *hint, field_sample *out)
{
    const mesh_surface *s = (const mesh_surface *)f;
    double weight[3];
    size_t n, patch;
    if (*hint < s->mesh.m.triangle_count) {
        patch = patch_of(s, *hint);
        const bool is_on = is_close(s, *hint, x) && walk(s, hint, x, weight) && touches(s, *hint, x, weight);
        if (!is_on) find_in_patch(&s->patch[patch], x, hint, weight);
        n = *hint - s->mesh.first[patch];
        if (!is_on && s->mesh.count > 1) triangle_forest_improve(s->trees, x, &patch, &n);
    } else {
        patch = triangle_forest_find(s->trees, x, &n);
    }
    const size_t found = s->patch[patch].first + n;
    *hint = (uint32_t)found;
    const uint32_t *t = s->mesh.m.triangle[found];
    const vec3 *v = s->mesh.m.vertex;
    triangle_weights(&(triangle){v[t[0]], v[t[1]], v[t[2]]}, x, weight);
    sample_triangle(s, found, weight, x, order, out);
    return true;
}

static bool find_first_crossing(const field *f, vec3 x, vec3 along, double within, uint32_t hint,
                                double *distance, vec3 *normal)
{
    const mesh_surface *s = (const mesh_surface *)f;
    const size_t patch = patch_of(s, hint);
    const ray_crossing own = {0, patch, hint - s->patch[patch].first},
                       found = triangle_forest_first_crossing(s->trees, x, along, within, &own);
    if (!(found.distance < INFINITY)) return false;
    const size_t n = s->patch[found.tree].first + found.triangle;
    const vec3 place = vec3_axpy(found.distance, along, x);
    const triangle t = corners_of(s, n);
    double weight[3];
    triangle_weights(&t, place, weight);
    *distance = found.distance;
    *normal = closest_point_on(s, n, weight, place).normal;
    return true;
}

static bool sample_all(const field *f, vec3 x, field_order order, field_sample *out)
{
    uint32_t hint = FIELD_NO_HINT;
    return sample_all_near(f, x, order, &hint, out);
}

/* ---- cells */

/* The position of a place. On an edge shared by two triangles both give the same bits. */
static vec3 place_of(const mesh_surface *s, uint32_t n, corner_weights w)
{
    const uint32_t *t = s->mesh.m.triangle[n];
    const vec3 *v = s->mesh.m.vertex;
    const int weight[3] = {w.of[0], w.of[1], WHOLE - w.of[0] - w.of[1]};
    vec3 sum = {0, 0, 0};
    for (int i = 0; i < 3; i++) sum = vec3_axpy(weight[i] * (1.0 / WHOLE), v[t[i]], sum);
    return sum;
}

static size_t count_cells(const field *f)
{
    const mesh_surface *s = (const mesh_surface *)f;
    return s->cell_count;
}

static int cell_triangles(const field *f, size_t k, vec3 out[FIELD_CELL_TRIANGLES][3])
{
    const mesh_surface *s = (const mesh_surface *)f;
    const piece p = piece_at(s, k);
    for (int i = 0; i < 3; i++) out[0][i] = place_of(s, p.triangle, p.corner[i]);
    return 1;
}

static void get_cell(const field *f, size_t k, field_cell *out)
{
    vec3 corner[FIELD_CELL_TRIANGLES][3];
    bbox box = bbox_empty();
    cell_triangles(f, k, corner);
    for (int i = 0; i < 3; i++) box = bbox_include(box, corner[0][i]);
    *out = (field_cell){0};
    for (int i = 0; i < 8; i++)
        out->corner[i] = vec3_make(i & 1 ? box.max.x : box.min.x, i & 2 ? box.max.y : box.min.y,
                                   i & 4 ? box.max.z : box.min.z);
}

static uint32_t patch_at(const field *f, size_t k, vec3 x)
{
    const mesh_surface *s = (const mesh_surface *)f;
    (void)x;
    return (uint32_t)patch_of(s, piece_at(s, k).triangle);
}

static uint32_t hint_of_cell(const field *f, size_t k)
{
    return piece_at((const mesh_surface *)f, k).triangle;
}

static double no_side(const field *f, vec3 x)
{
    (void)f;
    (void)x;
    return 0;
}

/* Approximate number of bytes that a scan of the surface keeps per piece. */
enum { SCAN_BYTES = 40 };

typedef struct division_limits {
    double longest; /* maximum edge length of a piece */
    size_t most;    /* maximum number of pieces */
} division_limits;

static bool refuse_pieces(const division_limits *c, error *e)
{
    return error_set(
        e, ERROR_LIMIT_MEMORY,
        "with sides of at most %.3g its triangles become more than %zu pieces, which need more "
        "memory than there is: ask for fewer points or a larger spacing, or raise limits.memory_mb",
        c->longest, c->most);
}

static bool is_whole(const piece *p)
{
    return p->corner[0].of[0] == WHOLE && p->corner[1].of[1] == WHOLE && p->corner[2].of[0] == 0 &&
           p->corner[2].of[1] == 0;
}

static bool add_piece(mesh_surface *s, const piece *p, const division_limits *c, error *e)
{
    if (s->cell_count == c->most) return refuse_pieces(c, e);
    s->cell_count++;
    if (is_whole(p)) return true;
    if (s->piece_count % BLOCK == 0) {
        const size_t block = s->piece_count / BLOCK;
        if (!MEM_GROW(s->pieces, block, &s->block_room, what, e) ||
            !(s->pieces[block] = mem_array(BLOCK, sizeof **s->pieces, what, e)))
            return false;
    }
    *cut_piece_at(s, s->piece_count++) = *p;
    return true;
}

/* Halves the edges that are too long, down to the resolution of the weights. The decision depends on the ends
 * of an edge only, so that the pieces on both sides agree. */
static bool cut_piece(mesh_surface *s, const piece *p, const vec3 corner[3], const division_limits *c,
                      error *e)
{
    vec3 at[6] = {corner[0], corner[1], corner[2]}; /* entry 3 + k: the midpoint of the edge from corner k */
    corner_weights w[6] = {p->corner[0], p->corner[1], p->corner[2]};
    bool halved[3] = {false, false, false};
    int parts[4][3];
    for (int k = 0; k < 3; k++) {
        const uint16_t *one = w[k].of, *two = w[(k + 1) % 3].of;
        if (!(vec3_norm2(vec3_sub(at[k], at[(k + 1) % 3])) > c->longest * c->longest) ||
            ((one[0] ^ two[0]) | (one[1] ^ two[1])) & 1)
            continue;
        for (int i = 0; i < 2; i++) w[3 + k].of[i] = (uint16_t)((one[i] + two[i]) / 2);
        at[3 + k] = place_of(s, p->triangle, w[3 + k]);
        halved[k] = true;
    }
    const int count = triangle_split(halved, parts);
    if (count == 1) return add_piece(s, p, c, e);
    for (int n = 0; n < count; n++) {
        const int *of = parts[n];
        const piece part = {p->triangle, {w[of[0]], w[of[1]], w[of[2]]}};
        if (!cut_piece(s, &part, (vec3[]){at[of[0]], at[of[1]], at[of[2]]}, c, e)) return false;
    }
    return true;
}

/* Bytes of the triangles and vertices, with their normals, shape operators and adjacency. */
static size_t triangle_bytes(const mesh_surface *s)
{
    const mesh *m = &s->mesh.m;
    const size_t given = s->whole ? s->given.triangle_count * sizeof *m->triangle : 0,
                 whole = s->whole ? sizeof *s->whole : 0;
    return given + m->triangle_count * (sizeof *m->triangle + sizeof *s->beside + whole) +
           m->vertex_count * (sizeof(vec3) + sizeof *s->at + sizeof *s->shape);
}

static bool add_divided(mesh_surface *s, size_t number, size_t stored, error *e)
{
    if (!MEM_GROW(s->divided, s->divided_count, &s->divided_room, what, e)) return false;
    s->divided[s->divided_count++] = (divided_triangle){(uint32_t)number, (uint32_t)stored};
    return true;
}

/* Makes the index of piece_at. */
static bool index_pieces(mesh_surface *s, error *e)
{
    s->divided_before = mem_array(s->cell_count / STRIDE + 1, sizeof *s->divided_before, what, e);
    for (size_t k = 0, before = 0; s->divided_before && k <= s->cell_count / STRIDE; k++) {
        while (before < s->divided_count && s->divided[before].number < k * STRIDE) before++;
        s->divided_before[k] = (uint32_t)before;
    }
    return s->divided_before != NULL;
}

static double longest_edge(const mesh *m)
{
    double most = 0;
    for (size_t n = 0; n < m->triangle_count; n++)
        for (int k = 0; k < 3; k++)
            most = fmax(most, vec3_norm2(vec3_sub(m->vertex[m->triangle[n][k]],
                                                  m->vertex[m->triangle[n][(k + 1) % 3]])));
    return sqrt(most);
}

static bool cut_pieces(mesh_surface *s, double longest, size_t memory_limit, const threads *pool, error *e)
{
    const mesh *m = &s->mesh.m;
    const division_limits c = {longest,
                               mem_left(memory_limit, triangle_bytes(s)) / (sizeof(piece) + SCAN_BYTES)};
    /* the pieces along the longest edge alone would exceed the limit: refused before the recursion goes so
     * deep */
    if (longest_edge(m) / longest > (double)c.most) return refuse_pieces(&c, e);
    for (uint32_t n = 0; n < m->triangle_count; n++) {
        const piece all = whole_triangle(n);
        const uint32_t *t = m->triangle[n];
        const size_t number = s->cell_count, stored = s->piece_count;
        if (!threads_may_go_on(pool, e) ||
            !cut_piece(s, &all, (vec3[]){m->vertex[t[0]], m->vertex[t[1]], m->vertex[t[2]]}, &c, e) ||
            (s->piece_count > stored && !add_divided(s, number, stored, e)))
            return false;
    }
    return index_pieces(s, e);
}

/* Refines the triangles where the surface bends, to sides of at most `longest`, then computes the vertex
 * normals. */
static bool make_vertices(mesh_surface *s, double longest, size_t memory_limit, threads *pool, error *e)
{
    mesh_patches *m = &s->mesh;
    vec3 *normal = NULL;
    const size_t most = memory_limit / REFINED_BYTES;
    s->given = (mesh){m->m.vertex_count, m->m.triangle_count, NULL,
                      mem_array(m->m.triangle_count, sizeof *m->m.triangle, what, e), false};
    bool changed = true, ok = s->given.triangle != NULL;
    if (ok) memcpy(s->given.triangle, m->m.triangle, m->m.triangle_count * sizeof *m->m.triangle);
    for (int round = 0; ok && changed && round < MOST_ROUNDS; round++) {
        free(normal);
        normal = mem_array(m->m.vertex_count, sizeof *normal, what, e);
        ok = normal && find_normals(s, pool, normal, e) &&
             mesh_refine(&m->m, normal, longest, most, m->first, m->count, &s->whole, &changed, pool, e);
    }
    s->given.vertex = m->m.vertex;
    if (!s->whole) {
        free(s->given.triangle);
        s->given.triangle = m->m.triangle;
    }
    s->at = ok ? mem_array(m->m.vertex_count, sizeof *s->at, what, e) : NULL;
    for (size_t v = 0; s->at && v < m->m.vertex_count; v++)
        s->at[v] = (surface_vertex){m->m.vertex[v], normal[v]};
    free(normal);
    return s->at != NULL;
}

/* ---- the whole */

static const field_ops whole_ops = {.sample = sample_all,
                                    .cell_count = count_cells,
                                    .cell = get_cell,
                                    .side = no_side,
                                    .sample_patch_lanes = sample_patch_lanes,
                                    .sample_near = sample_all_near,
                                    .first_crossing = find_first_crossing,
                                    .cell_triangles = cell_triangles,
                                    .cell_hint = hint_of_cell,
                                    .patch_at = patch_at};
static const field_ops patch_ops = {
    .sample = sample_patch, .sample_near = sample_patch_near, .side = no_side, .within = is_within};

static bool make_tree_of_trees(mesh_surface *s, error *e)
{
    const triangle_tree **tree = mem_array(s->mesh.count, sizeof *tree, what, e);
    for (size_t k = 0; tree && k < s->mesh.count; k++) tree[k] = s->patch[k].tree;
    if (tree) s->trees = triangle_forest_new(tree, s->mesh.count, e);
    free(tree);
    return s->trees != NULL;
}

static bool make_patches(mesh_surface *s, const threads *pool, error *e)
{
    mesh_patches *m = &s->mesh;
    double all = 0;
    s->patches = (field_patches){m->count,
                                 mem_array(m->count, sizeof *s->patches.patch, what, e),
                                 m->curve_count,
                                 m->curve,
                                 m->vertex,
                                 m->curve_patch,
                                 m->merges_near_curves,
                                 m->has_rough_curves,
                                 m->has_many_parts};
    s->patch = mem_array(m->count, sizeof *s->patch, what, e);
    if (!s->patches.patch || !s->patch) return false;
    for (size_t k = 0; k < m->count; k++) {
        patch_field *p = &s->patch[k];
        const size_t first = m->first[k], triangles = m->first[k + 1] - first;
        *p = (patch_field){.base = s->base, .whole = s, .first = first};
        p->base.ops = &patch_ops;
        p->triangles = (mesh){m->m.vertex_count, triangles, m->m.vertex, m->m.triangle + first, false};
        if (!(p->tree = triangle_tree_new(&p->triangles, pool, e))) return false;
        const double area = mesh_area(&p->triangles);
        s->patches.patch[k] = (field_patch){&p->base, m->one_sided[k], fmax(area, DBL_MIN)};
        all += area;
    }
    if (!(all > 0))
        return error_set(e, ERROR_NO_SURFACE, "the triangles of the mesh have no area: repair the mesh");
    return make_tree_of_trees(s, e);
}

static bool make(mesh_surface *s, double longest, size_t memory_limit, threads *pool, error *e)
{
    const mesh *m = &s->mesh.m;
    const bbox box = mesh_box(m, NULL);
    const double extent = bbox_longest(box);
    /* margin for flat meshes, and for trial positions slightly off the surface */
    s->base = (field){.ops = &whole_ops, .domain = bbox_grow(box, 0.05 * extent), .extent = extent};
    s->base.cell_size = longest;
    field_set_boundary(&s->base, 0);
    for (size_t k = 0; k < s->mesh.count; k++) s->has_one_sided |= s->mesh.one_sided[k];
    if (!make_vertices(s, longest, memory_limit, pool, e)) return false;
    s->shape = mem_array(m->vertex_count, sizeof *s->shape, what, e);
    s->at_end = mem_array(m->vertex_count, sizeof *s->at_end, what, e);
    s->beside = mem_array(m->triangle_count, sizeof *s->beside, what, e);
    if (!s->shape || !s->at_end || !s->beside) return false;
    if (!threads_may_go_on(pool, e) || !find_shapes(s, pool, e) || !smooth_shapes(s, longest, pool, e) ||
        !find_sides(s, pool, e) || !threads_may_go_on(pool, e) ||
        !cut_pieces(s, longest, memory_limit, pool, e) || !make_patches(s, pool, e))
        return false;
    s->base.patches = &s->patches;
    return true;
}

mesh_surface *mesh_surface_new(mesh_patches *patches, double longest, size_t memory_limit, threads *pool,
                               error *e)
{
    mesh_surface *s = mem_alloc(sizeof *s);
    s->mesh = *patches;
    *patches = (mesh_patches){0};
    if (make(s, longest, memory_limit, pool, e)) return s;
    mesh_surface_free(s);
    return NULL;
}

void mesh_surface_free(mesh_surface *s)
{
    if (!s) return;
    triangle_forest_free(s->trees);
    for (size_t k = 0; s->patch && k < s->mesh.count; k++) triangle_tree_free(s->patch[k].tree);
    if (s->whole) free(s->given.triangle);
    free(s->whole);
    mesh_patches_free(&s->mesh);
    free(s->patches.patch);
    free(s->patch);
    free(s->at);
    free(s->shape);
    free(s->at_end);
    free(s->beside);
    for (size_t k = 0; k * BLOCK < s->piece_count; k++) free(s->pieces[k]);
    free(s->pieces);
    free(s->divided);
    free(s->divided_before);
    free(s);
}

void mesh_surface_drop_shapes(mesh_surface *s)
{
    free(s->shape);
    s->shape = NULL;
}

const field *mesh_surface_field(const mesh_surface *s)
{
    return &s->base;
}

const mesh_patches *mesh_surface_patches(const mesh_surface *s)
{
    return &s->mesh;
}

size_t mesh_surface_triangles(const mesh_surface *s)
{
    return s->given.triangle_count;
}

const mesh *mesh_surface_given(const mesh_surface *s)
{
    return &s->given;
}

const uint32_t (*mesh_surface_neighbours(const mesh_surface *s, uint32_t (**own_list)[3], error *e))[3]
{
    *own_list = NULL;
    if (!s->whole) return (const uint32_t(*)[3])s->beside;
    const size_t count = s->given.triangle_count;
    uint32_t(*out)[3] = mem_array(count, sizeof *out, what, e);
    if (!out) return NULL;
    for (size_t n = 0; n < count; n++)
        for (int k = 0; k < 3; k++) out[n][k] = NO_TRIANGLE;
    for (size_t n = 0; n < s->mesh.m.triangle_count; n++)
        for (int k = 0; k < 3; k++) {
            const uint32_t across = s->beside[n][k], own = s->whole[n];
            if (across == NO_TRIANGLE || s->whole[across] == own) continue;
            /* the side of `own` whose opposite corner is not of the other one */
            const uint32_t other = s->whole[across], *t = s->given.triangle[own],
                           *u = s->given.triangle[other];
            for (int side = 0; side < 3; side++) {
                const uint32_t far = t[(side + 2) % 3];
                if (u[0] != far && u[1] != far && u[2] != far) out[own][side] = other;
            }
        }
    *own_list = out;
    return (const uint32_t(*)[3])out;
}

double mesh_surface_crease(const mesh_surface *s)
{
    return s->mesh.feature_edges > 0 ? INFINITY : MESH_PATCHES_ANGLE;
}

/* The triangle that has a point, by the rule of mesh_place.h. */
static uint32_t place_triangle(const mesh_surface *s, uint32_t patch, vec3 x, vec3 normal)
{
    mesh_place place;
    size_t tree = patch;
    if (patch < s->mesh.count)
        mesh_place_find(s->patch[patch].tree, x, &normal, INFINITY, &place);
    else
        mesh_place_find_among(s->trees, x, &normal, INFINITY, &tree, &place);
    return (uint32_t)(s->patch[tree].first + place.triangle);
}

mesh_place mesh_surface_find_given(const mesh_surface *s, uint32_t patch, vec3 x, vec3 normal, uint32_t hint)
{
    mesh_place out = {.triangle = hint};
    const bool is_hint = patch < s->mesh.count && is_of_patch(&s->patch[patch], hint);
    if (!is_hint || !walk(s, &out.triangle, x, out.weight) || !touches(s, out.triangle, x, out.weight))
        out.triangle = place_triangle(s, patch, x, normal);
    if (s->whole) out.triangle = s->whole[out.triangle];
    const uint32_t *t = s->given.triangle[out.triangle];
    const vec3 *v = s->given.vertex;
    const triangle of = {v[t[0]], v[t[1]], v[t[2]]};
    triangle_weights(&of, x, out.weight);
    out.distance = sqrt(triangle_distance2(&of, x));
    return out;
}

vec3 mesh_surface_nearest(const mesh_surface *s, vec3 x)
{
    vec3 place = x;
    if (!triangle_forest_find_accepted(s->trees, x, touching * s->base.extent, NULL, NULL, &place))
        triangle_forest_find_accepted(s->trees, x, INFINITY, NULL, NULL, &place);
    return place;
}

size_t mesh_surface_places(const mesh_surface *s, vec3 x, mesh_surface_place out[MESH_SURFACE_PLACES])
{
    mesh_place_in found[MESH_SURFACE_PLACES];
    const size_t count = mesh_place_find_each(s->trees, x, INFINITY, MESH_SURFACE_PLACES, found);
    for (size_t k = 0; k < count; k++) {
        const mesh_place *p = &found[k].place;
        const uint32_t n = (uint32_t)s->patch[found[k].tree].first + p->triangle;
        const closest_point at = closest_point_on(s, n, p->weight, x);
        out[k] = (mesh_surface_place){(uint32_t)found[k].tree, n, at.normal, p->distance};
    }
    return count;
}

size_t mesh_surface_bytes(const mesh_surface *s)
{
    size_t trees = triangle_forest_bytes(s->trees);
    for (size_t k = 0; k < s->mesh.count; k++) trees += triangle_tree_bytes(s->patch[k].tree);
    return trees + triangle_bytes(s) + s->piece_count * sizeof(piece) + s->divided_count * sizeof *s->divided;
}
