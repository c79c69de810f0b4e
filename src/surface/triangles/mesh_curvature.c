// SPDX-License-Identifier: Apache-2.0
#include "surface/triangles/mesh_curvature.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "surface/triangles/jet.h"
#include "surface/triangles/mesh_facets.h"
#include "surface/triangles/smooth_sides.h"

static const char what[] = "the curvature of a mesh";

/* Number of neighbours of a fit, over the number of its coefficients. Fewer: noise and irregular neighbourhoods are
 * amplified. More: details of the surface are smoothed. */
enum { PER_COEFFICIENT = 2 };
/* Minimum condition (jet_condition) of a fit. Smaller: rings of quads with few distinct positions are taken, with
 * errors of some ten per cent. Larger: good fits are discarded for those of a lower degree. */
static const double LEAST_CONDITION = 0.02;
/* Minimum cosine between the normal of a neighbour's triangle and that of the vertex: the surface is a graph over
 * the tangent plane, and opposite walls are excluded. */
static const double LEAST_COSINE = 0.5;
/* Minimum sum of the weights of the corners of a position with a defined curvature. */
static const double LEAST_DEFINED = 0.5;
/* Maximum angle by which a crease turns at a vertex that is no corner, radians. */
static const double CREASE_BEND = 0.7;
/* VISITED: maximum number of corners of a neighbourhood. SLOTS: of its hash
 * table. SECTOR_MOST: triangles of a sector that are visited. GRAIN: jets of a task. */
enum { VISITED = 1024, SLOTS = 4 * VISITED, SLOT_SHIFT = 32 - 12, SECTOR_MOST = 4096, GRAIN = 256 };

/* A fit: a sector of a vertex. */
typedef struct site {
    uint32_t triangle;
    uint8_t corner;
} site;

struct mesh_curvature {
    smooth_sides sides;
    mesh_facets facets;
    uint32_t (*site_of)[3]; /* per corner of a triangle: the index of its site plus 1; 0: not requested */
    site *site;
    mesh_curvature_value *value; /* of each site */
    size_t count, room;          /* room: of `site` */
};

mesh_curvature *mesh_curvature_new(const mesh *m, const uint32_t (*beside)[3], double crease, threads *pool,
                                   error *e)
{
    mesh_curvature *c = mem_alloc(sizeof *c);
    c->site_of = mem_array(m->triangle_count, sizeof *c->site_of, what, e);
    if (c->site_of && smooth_sides_make(m, beside, crease, pool, &c->sides, e) &&
        mesh_facets_begin(&c->sides, &c->facets, e))
        return c;
    mesh_curvature_free(c);
    return NULL;
}

void mesh_curvature_free(mesh_curvature *c)
{
    if (!c) return;
    mesh_facets_free(&c->facets);
    smooth_sides_free(&c->sides);
    free(c->site_of);
    free(c->site);
    free(c->value);
    free(c);
}

size_t mesh_curvature_jets(const mesh_curvature *c)
{
    return c->count;
}

/* ---- requests */

/* The mean normal of a sector, weighted by area, on the side of `triangle`. *is_flat: the sector lies in a plane
 * between two creases. */
static vec3 sector_normal(const mesh_curvature *c, uint32_t triangle, int corner, bool *is_flat)
{
    const smooth_sides *s = &c->sides;
    sector_walk w = sector_walk_begin(s, triangle, corner);
    vec3 sum = {0, 0, 0};
    *is_flat = true;
    do {
        if (!w.is_again) sum = vec3_axpy(w.at.is_reversed ? -1 : 1, mesh_across(s->m, w.at.triangle), sum);
        *is_flat &= sector_is_coplanar(s, &w.at) || smooth_sides_is_crease(s, w.at.triangle, w.at.side);
    } while (sector_walk_next(s, &w));
    *is_flat &= w.is_open;
    return vec3_unit(sum);
}

/* Adds the site of a corner, unless there is one. It is that of the sector's triangle with the lowest index, so that
 * it does not depend on the requests. */
static bool request_site(mesh_curvature *c, uint32_t triangle, uint32_t corner, error *e)
{
    if (c->site_of[triangle][corner] > 0) return true;
    if (!MEM_GROW(c->site, c->count, &c->room, what, e)) return false;
    site *added = &c->site[c->count++];
    *added = (site){.triangle = triangle, .corner = (uint8_t)corner};
    sector_walk w = sector_walk_begin(&c->sides, triangle, (int)corner);
    do {
        c->site_of[w.at.triangle][w.at.corner] = (uint32_t)c->count;
        if (w.at.triangle < added->triangle)
            *added = (site){.triangle = w.at.triangle, .corner = w.at.corner};
    } while (sector_walk_next(&c->sides, &w));
    return true;
}

static bool request_triangle(mesh_curvature *c, uint32_t triangle, error *e)
{
    if (mesh_facets_is_single(&c->facets, triangle)) {
        for (uint32_t k = 0; k < 3; k++)
            if (!request_site(c, triangle, k, e)) return false;
        return true;
    }
    if (!mesh_facets_request(&c->facets, triangle, e)) return false;
    const mesh_facet *f = mesh_facets_of(&c->facets, triangle);
    for (size_t k = 0; k < f->corner_count; k++)
        if (!request_site(c, f->corner[k].triangle, f->corner[k].corner, e)) return false;
    return true;
}

/* ---- neighbourhoods */

/* A vertex of a neighbourhood, as a corner of a triangle. */
typedef struct visited {
    uint32_t vertex, triangle;
    uint8_t corner;
    bool is_reversed; /* the triangle is oriented against that of the site */
} visited;

typedef struct neighbourhood {
    const mesh_curvature *c;
    vec3 normal;
    int count, listed;       /* corners; those whose neighbours are in the list */
    visited vertex[VISITED]; /* the first one is that of the site */
    vec3 local[VISITED];     /* the corners in the frame, in units of it */
    uint64_t slot[SLOTS];    /* `now` and a vertex; with another `now`: free */
    uint32_t now;
} neighbourhood;

/* The slot of a vertex, or the free slot at which it belongs. */
static uint32_t slot_of(const neighbourhood *n, uint32_t vertex)
{
    static const uint32_t golden = 2654435769u; /* Knuth's multiplicative hash */
    uint32_t at = (vertex * golden) >> SLOT_SHIFT;
    while (n->slot[at] >> 32 == n->now && (uint32_t)n->slot[at] != vertex) at = (at + 1) % SLOTS;
    return at;
}

/* Whether a vertex is in the list; otherwise *slot is a free one for it. */
static bool is_listed(const neighbourhood *n, uint32_t vertex, uint32_t *slot)
{
    *slot = slot_of(n, vertex);
    return n->slot[*slot] >> 32 == n->now;
}

/* Adds a vertex at a free slot, unless the list is full. */
static void visit(neighbourhood *n, uint32_t slot, visited v)
{
    if (n->count == VISITED) return;
    n->slot[slot] = (uint64_t)n->now << 32 | v.vertex;
    n->vertex[n->count++] = v;
}

/* Whether the angle between the normal of a triangle and that of the vertex is small enough. */
static bool is_facing(const neighbourhood *n, uint32_t triangle, bool is_reversed)
{
    const vec3 cross = mesh_across(n->c->sides.m, triangle);
    const double up = vec3_dot(cross, n->normal) * (is_reversed ? -1 : 1);
    return up > 0 && up * up >= LEAST_COSINE * LEAST_COSINE * vec3_norm2(cross);
}

/* Adds the other end of the step's side. If that is no corner of a facet, the side is followed to the next one,
 * unless it lies within a facet. */
static void visit_end(neighbourhood *n, const sector_step *at, bool is_reversed)
{
    const smooth_sides *s = &n->c->sides;
    const int k = sector_far_corner(at);
    uint32_t slot;
    if (is_listed(n, at->far, &slot)) return;
    visited v = {at->far, at->triangle, (uint8_t)k, is_reversed};
    if (!sector_is_corner(s, at->triangle, k)) {
        if (sector_is_coplanar(s, at)) return;
        const sector_step end = sector_follow(s, *at);
        v = (visited){s->m->triangle[end.triangle][end.corner], end.triangle, end.corner,
                      is_reversed != (end.is_reversed != at->is_reversed)};
        if (is_listed(n, v.vertex, &slot)) return;
    }
    if (is_facing(n, v.triangle, v.is_reversed)) visit(n, slot, v);
}

/* Adds the corners around v. */
static void visit_sector(neighbourhood *n, const visited *v)
{
    sector_walk w = sector_walk_begin(&n->c->sides, v->triangle, v->corner);
    do visit_end(n, &w.at, w.at.is_reversed != v->is_reversed);
    while (n->count < VISITED && sector_walk_next(&n->c->sides, &w));
}

static void begin_neighbourhood(neighbourhood *n, const site *of)
{
    n->now++;
    n->count = n->listed = 0;
    const uint32_t vertex = n->c->sides.m->triangle[of->triangle][of->corner];
    visit(n, slot_of(n, vertex), (visited){vertex, of->triangle, of->corner, false});
}

/* Adds the next ring. False: there is none. */
static bool add_ring(neighbourhood *n)
{
    const int end = n->count;
    while (n->listed < end) {
        const visited v = n->vertex[n->listed++];
        visit_sector(n, &v);
    }
    return n->count > end;
}

/* Adds rings until there are `least` corners, then `further` rings. */
static void grow(neighbourhood *n, int least, int further)
{
    while (n->count < least && add_ring(n)) {
    }
    while (further-- > 0 && add_ring(n)) {
    }
}

/* ---- fits */

/* The attempts of a fit, in this order. */
typedef struct attempt {
    int degree, further; /* further rings */
    bool is_strip;
} attempt;

static const attempt attempts[] = {{4, 0, false}, {4, 1, false}, {3, 0, false}, {3, 1, false},
                                   {2, 0, false}, {2, 1, false}, {4, 0, true}};
enum { ATTEMPTS = sizeof attempts / sizeof *attempts };

/* A tangent plane, and the unit of lengths in it. */
typedef struct frame {
    vec3 u, v, n;
    double unit;
} frame;

/* Turns u and v to the principal axes of the corners: the monomials of a neighbourhood that is longer than wide are
 * then as independent as those of a round one. Sets `local`. */
static frame frame_of(neighbourhood *n)
{
    const vec3 *at = n->c->sides.m->vertex;
    frame f = {.n = n->normal};
    double aa = 0, ab = 0, bb = 0;
    vec3_frame(f.n, &f.u, &f.v);
    for (int k = 0; k < n->count; k++) {
        const vec3 d = vec3_sub(at[n->vertex[k].vertex], at[n->vertex[0].vertex]);
        const vec3 x = {vec3_dot(d, f.u), vec3_dot(d, f.v), vec3_dot(d, f.n)};
        aa += x.x * x.x;
        ab += x.x * x.y;
        bb += x.y * x.y;
        n->local[k] = x;
    }
    /* c and s: of half the angle whose tangent is 2 ab / (aa - bb) */
    const double size = sqrt((aa - bb) * (aa - bb) + 4 * ab * ab), cosine = size > 0 ? (aa - bb) / size : 1,
                 c = sqrt(fmax(0.5 * (1 + cosine), 0)), s = copysign(sqrt(fmax(0.5 * (1 - cosine), 0)), ab);
    const vec3 u = f.u;
    f.unit = sqrt((aa + bb) / fmax(n->count - 1, 1));
    f.u = vec3_axpy(s, f.v, vec3_scale(u, c));
    f.v = vec3_axpy(-s, u, vec3_scale(f.v, c));
    const double over = f.unit > 0 ? 1 / f.unit : 0;
    for (int k = 0; k < n->count; k++) {
        const vec3 x = vec3_scale(n->local[k], over);
        n->local[k] = (vec3){c * x.x + s * x.y, c * x.y - s * x.x, x.z};
    }
    return f;
}

/* Fills in a lane; of more corners than rows, takes as many, evenly distributed in the list. The weight of a corner
 * at the distance d from the vertex is 1 / (1 + (d / unit)^2)^2: near corners matter most, so that the fit may have
 * more rows than coefficients where the surface bends within the neighbourhood. */
static void fill_lane(const neighbourhood *n, int lane, jet_lanes *j)
{
    const int rows = n->count < JET_ROWS ? n->count : JET_ROWS;
    for (int r = 0; r < rows; r++) {
        const vec3 d = n->local[r * n->count / rows];
        j->u[r][lane] = d.x;
        j->v[r][lane] = d.y;
        const double near = 1 / (1 + vec3_norm2(d));
        j->weight[r][lane] = near * near;
        j->w[r][lane] = j->weight[r][lane] * d.z;
    }
    if (rows > j->rows) j->rows = rows;
}

static sym3 outer(double scale, vec3 a, vec3 b)
{
    return (sym3){scale * a.x * b.x,
                  scale * a.y * b.y,
                  scale * a.z * b.z,
                  0.5 * scale * (a.x * b.y + a.y * b.x),
                  0.5 * scale * (a.x * b.z + a.z * b.x),
                  0.5 * scale * (a.y * b.z + a.z * b.y)};
}

static sym3 add(sym3 a, sym3 b)
{
    return (sym3){a.xx + b.xx, a.yy + b.yy, a.zz + b.zz, a.xy + b.xy, a.xz + b.xz, a.yz + b.yz};
}

/* The shape operator of a graph over the frame, from its first and second fundamental forms. */
static mesh_curvature_value value_of(const jet *j, const frame *f)
{
    const double p = j->wu, q = j->wv, area2 = 1 + p * p + q * q, over = -1 / (f->unit * sqrt(area2));
    /* dual vectors of the tangent vectors u + p n and v + q n */
    const vec3 a = vec3_axpy(p, f->n, f->u), b = vec3_axpy(q, f->n, f->v);
    const vec3 da = vec3_scale(vec3_axpy(-p * q, b, vec3_scale(a, 1 + q * q)), 1 / area2),
               db = vec3_scale(vec3_axpy(-p * q, a, vec3_scale(b, 1 + p * p)), 1 / area2);
    const sym3 shape = add(add(outer(over * j->wuu, da, da), outer(2 * over * j->wuv, da, db)),
                           outer(over * j->wvv, db, db));
    const vec3 normal = vec3_unit(vec3_axpy(-p, f->u, vec3_axpy(-q, f->v, f->n)));
    const double size = shape.xx + shape.yy + shape.zz + shape.xy + shape.xz + shape.yz;
    return isfinite(size) ? (mesh_curvature_value){true, normal, shape}
                          : (mesh_curvature_value){.normal = f->n};
}

/* The number of corners of a neighbourhood. Those of a strip lie on two lines. */
static int least_corners(const attempt *how)
{
    return PER_COEFFICIENT * (how->is_strip ? how->degree + 1 : jet_coefficients(how->degree));
}

/* Takes the fit of a lane, if it is good enough. */
static bool take_lane(const jet_lanes *j, int lane, jet found, int corners, const attempt *how,
                      const frame *f, mesh_curvature_value *out)
{
    const int most = corners < JET_ROWS ? corners : JET_ROWS;
    if (how->is_strip) {
        if (!jet_solve_strip(j, lane, how->degree, LEAST_CONDITION, &found)) return false;
    } else {
        const int least = how->degree > 2 ? least_corners(how) : jet_coefficients(how->degree);
        if (most < least || !(jet_condition(j, lane, how->degree) >= LEAST_CONDITION)) return false;
    }
    *out = value_of(&found, f);
    return out->defined;
}

/* Fits up to JET_LANES sites. Removes those that were fitted from the list; returns the number of others. */
static int fit_lanes(mesh_curvature *c, neighbourhood *n, jet_lanes *j, const attempt *how, uint32_t *list,
                     int count)
{
    frame f[JET_LANES] = {{.unit = 0}};
    jet found[JET_LANES];
    int corners[JET_LANES], left = 0;
    memset(j, 0, offsetof(jet_lanes, factor));
    for (int l = 0; l < count; l++) {
        const site *of = &c->site[list[l]];
        n->normal = c->value[list[l]].normal;
        begin_neighbourhood(n, of);
        grow(n, least_corners(how), how->further);
        f[l] = frame_of(n);
        corners[l] = f[l].unit > 0 ? n->count : 0;
        if (corners[l] == 0) n->count = 0;
        fill_lane(n, l, j);
    }
    jet_factor(j);
    jet_solve(j, how->degree, found);
    for (int l = 0; l < count; l++)
        if (corners[l] == 0 || !take_lane(j, l, found[l], corners[l], how, &f[l], &c->value[list[l]]))
            list[left++] = list[l];
    return left;
}

typedef struct fit_job {
    mesh_curvature *c;
    size_t first;
} fit_job;

static void fit_chunk(void *context, int worker, size_t begin, size_t end)
{
    const fit_job *job = context;
    mesh_curvature *c = job->c;
    neighbourhood *n = mem_alloc(sizeof *n);
    jet_lanes *j = mem_array(1, sizeof *j, what, NULL);
    uint32_t list[GRAIN];
    int count = 0;
    (void)worker;
    n->c = c;
    for (size_t k = begin; k < end; k++) {
        const site *s = &c->site[job->first + k];
        bool is_flat;
        mesh_curvature_value *value = &c->value[job->first + k];
        *value = (mesh_curvature_value){.normal = sector_normal(c, s->triangle, s->corner, &is_flat)};
        value->defined = is_flat;
        if (!is_flat) list[count++] = (uint32_t)(job->first + k);
    }
    for (int a = 0; a < ATTEMPTS && count > 0; a++) {
        int left = 0;
        for (int k = 0; k < count; k += JET_LANES) {
            uint32_t lanes[JET_LANES];
            const int used = count - k < JET_LANES ? count - k : JET_LANES;
            memcpy(lanes, list + k, (size_t)used * sizeof *lanes);
            const int kept = fit_lanes(c, n, j, &attempts[a], lanes, used);
            memcpy(list + left, lanes, (size_t)kept * sizeof *lanes);
            left += kept;
        }
        count = left;
    }
    free(n);
    free(j);
}

/* Makes room for the values of sites from `first` on. */
static bool add_values(mesh_curvature *c, size_t first, error *e)
{
    mesh_curvature_value *all = mem_array(c->count + 1, sizeof *all, what, e);
    if (!all) return false;
    if (first > 0) memcpy(all, c->value, first * sizeof *all);
    free(c->value);
    c->value = all;
    return true;
}

bool mesh_curvature_prepare(mesh_curvature *c, const uint32_t *triangle, size_t count, threads *pool,
                            error *e)
{
    const fit_job job = {c, c->count};
    for (size_t k = 0; k < count; k++)
        if (!request_triangle(c, triangle[k], e)) return false;
    if (!add_values(c, job.first, e)) return false;
    threads_run(pool, c->count - job.first, GRAIN, fit_chunk, (void *)&job);
    return threads_may_go_on(pool, e);
}

/* ---- values */

/* m turned from the normal n, to which it is tangential, to the normal `to`, by the smallest rotation. */
static sym3 turn(sym3 m, vec3 n, vec3 to)
{
    const vec3 h = vec3_add(n, to), mh = sym3_apply(m, h);
    const double over = 1 / (1 + vec3_dot(n, to));
    return add(add(m, outer(-2 * over, mh, h)), outer(over * over * vec3_dot(h, mh), h, h));
}

/* The value of a corner, on the side of the normal. */
static mesh_curvature_value value_on_side(const mesh_curvature *c, const mesh_facet_corner *of, vec3 normal)
{
    mesh_curvature_value v = c->value[c->site_of[of->triangle][of->corner] - 1];
    if (!(vec3_dot(v.normal, normal) < 0)) return v;
    v.normal = vec3_scale(v.normal, -1);
    v.shape =
        add((sym3){0}, (sym3){-v.shape.xx, -v.shape.yy, -v.shape.zz, -v.shape.xy, -v.shape.xz, -v.shape.yz});
    return v;
}

typedef struct first_pass {
    const mesh_curvature *c;
    vec3 side, normal;
    double all, defined;
} first_pass;

typedef struct second_pass {
    const mesh_curvature *c;
    vec3 side, normal;
    sym3 shape;
} second_pass;

static void add_normal(void *context, const mesh_facet_corner *corner, double weight)
{
    first_pass *p = context;
    if (!corner) {
        *p = (first_pass){.c = p->c, .side = p->side};
        return;
    }
    const mesh_curvature_value v = value_on_side(p->c, corner, p->side);
    p->all += weight;
    if (!v.defined) return;
    p->defined += weight;
    p->normal = vec3_axpy(weight, v.normal, p->normal);
}

static void add_shape(void *context, const mesh_facet_corner *corner, double weight)
{
    second_pass *p = context;
    if (!corner) {
        p->shape = (sym3){0};
        return;
    }
    const mesh_curvature_value v = value_on_side(p->c, corner, p->side);
    if (!v.defined) return;
    const sym3 turned = turn(v.shape, v.normal, p->normal);
    p->shape = add(p->shape, (sym3){weight * turned.xx, weight * turned.yy, weight * turned.zz,
                                    weight * turned.xy, weight * turned.xz, weight * turned.yz});
}

/* Calls `visit` for the corners of a triangle's facet. */
static void for_each_corner(const mesh_curvature *c, uint32_t triangle, const double weight[3],
                            mesh_facet_visitor *act, void *context)
{
    const mesh *m = c->sides.m;
    if (mesh_facets_is_single(&c->facets, triangle)) {
        for (uint32_t k = 0; k < 3; k++) act(context, &(mesh_facet_corner){triangle, k}, weight[k]);
        return;
    }
    vec3 x = {0, 0, 0};
    for (int k = 0; k < 3; k++) x = vec3_axpy(weight[k], m->vertex[m->triangle[triangle][k]], x);
    mesh_facet_weigh(mesh_facets_of(&c->facets, triangle), m, x, act, context);
}

mesh_curvature_value mesh_curvature_at(const mesh_curvature *c, uint32_t triangle, const double weight[3])
{
    const vec3 own = vec3_unit(mesh_across(c->sides.m, triangle));
    const mesh_curvature_value flat = {.defined = true, .normal = own}, unknown = {.normal = own};
    if (!mesh_facets_is_single(&c->facets, triangle) && mesh_facets_of(&c->facets, triangle)->is_apart)
        return flat;
    first_pass one = {.c = c, .side = own};
    for_each_corner(c, triangle, weight, add_normal, &one);
    const double share = one.defined / one.all;
    if (!(share >= LEAST_DEFINED) || !(vec3_norm2(one.normal) > 0)) return unknown;
    second_pass two = {
        .c = c, .side = own, .normal = vec3_unit(vec3_scale(one.normal, one.defined < 0 ? -1 : 1))};
    for_each_corner(c, triangle, weight, add_shape, &two);
    const sym3 s = two.shape;
    const double over = 1 / one.defined;
    const mesh_curvature_value v = {
        true, two.normal, {over * s.xx, over * s.yy, over * s.zz, over * s.xy, over * s.xz, over * s.yz}};
    return isfinite(v.shape.xx + v.shape.yy + v.shape.zz + v.shape.xy + v.shape.xz + v.shape.yz) ? v
                                                                                                 : unknown;
}

/* ---- creases */

static vec3 side_of(const mesh *m, uint32_t triangle, int k)
{
    const uint32_t *t = m->triangle[triangle];
    return vec3_sub(m->vertex[t[(k + 1) % 3]], m->vertex[t[k]]);
}

mesh_curvature_feature mesh_curvature_feature_at(const mesh_curvature *c, uint32_t triangle,
                                                 const double weight[3], vec3 *along)
{
    const smooth_sides *s = &c->sides;
    int zeros = 0, corner = 0, side = 0;
    for (int k = 0; k < 3; k++) {
        zeros += weight[k] == 0;
        if (weight[k] > 0) corner = k;
        if (weight[k] == 0) side = (k + 1) % 3; /* opposite to corner k */
    }
    if (zeros == 0) return MESH_CURVATURE_SMOOTH;
    if (zeros == 1) {
        *along = side_of(s->m, triangle, side);
        return smooth_sides_is_crease(s, triangle, side) ? MESH_CURVATURE_CREASE : MESH_CURVATURE_SMOOTH;
    }
    bool is_closed;
    const vec3 at = s->m->vertex[s->m->triangle[triangle][corner]];
    sector_step last = sector_first(s, triangle, corner, &is_closed);
    if (is_closed) return MESH_CURVATURE_SMOOTH;
    const sector_step first = sector_begin(s, last.triangle, last.corner, last.side != last.corner);
    for (int step = 0; step < SECTOR_MOST && sector_next(s, &last); step++) {
    }
    const vec3 in = vec3_sub(at, s->m->vertex[first.far]), out = vec3_sub(s->m->vertex[last.far], at);
    if (elementary_atan2(vec3_norm(vec3_cross(in, out)), vec3_dot(in, out)) > CREASE_BEND)
        return MESH_CURVATURE_CORNER;
    *along = vec3_add(in, out);
    return MESH_CURVATURE_CREASE;
}
