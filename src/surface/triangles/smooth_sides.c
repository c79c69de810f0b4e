// SPDX-License-Identifier: Apache-2.0
#include "surface/triangles/smooth_sides.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "geometry/mesh/mesh_edges.h"
#include "geometry/mesh/rounding.h"

static const char what[] = "the curvature of a mesh";

/* Triangles with a smaller dihedral angle are coplanar, radians: coordinates with six decimals have such angles in
 * the facets of a mesh. The radius of curvature is then more than 3 000 triangles. */
static const double FLAT_ANGLE = 3e-4;
/* Maximum sine of the angle by which the boundary of a facet turns at a vertex that is no corner. */
static const double STRAIGHT = 1e-3;
/* SECTOR_MOST: maximum number of triangles of a sector that are visited: an apex may have any number. GRAIN:
 * triangles or vertices of a task. CHAIN_MOST: maximum number of sides between two corners of a facet. */
enum { SECTOR_MOST = 4096, CHAIN_MOST = 1 << 24, GRAIN = 4096 };

#define NO_TRIANGLE UINT32_MAX

/* ---- neighbours */

static int begins_at(const mesh *m, const mesh_side *side, uint32_t v)
{
    const uint32_t *t = m->triangle[side->triangle], from = side->upwards ? v : side->other;
    return t[0] == from ? 0 : t[1] == from ? 1 : 2;
}

typedef struct listing {
    const mesh *m;
    const mesh_edges *edges;
    uint32_t (*beside)[3];
} listing;

static void list_chunk(void *context, int worker, size_t begin, size_t end)
{
    const listing *l = context;
    (void)worker;
    for (size_t v = begin; v < end; v++)
        for (size_t i = l->edges->first[v], n; i < l->edges->first[v + 1]; i += n) {
            n = mesh_edges_width(l->edges, v, i);
            const mesh_side *side = l->edges->sides + i;
            if (n != 2 || side[0].triangle == side[1].triangle) continue;
            for (int k = 0; k < 2; k++)
                l->beside[side[k].triangle][begins_at(l->m, &side[k], (uint32_t)v)] = side[1 - k].triangle;
        }
}

static bool list_neighbours(smooth_sides *s, threads *pool, error *e)
{
    mesh_edges edges = {0};
    s->own = mem_array(s->m->triangle_count, sizeof *s->own, what, e);
    const bool ok = s->own && mesh_edges_list(s->m, pool, &edges, e);
    for (size_t n = 0; ok && n < s->m->triangle_count; n++)
        for (int k = 0; k < 3; k++) s->own[n][k] = NO_TRIANGLE;
    if (ok) threads_run(pool, edges.vertex_count, GRAIN, list_chunk, &(listing){s->m, &edges, s->own});
    mesh_edges_free(&edges);
    s->beside = (const uint32_t(*)[3])s->own;
    return ok;
}

/* ---- creases and coplanar triangles */

typedef struct smooth_check {
    smooth_sides *s;
    double reach;  /* rounding error of the distance of a vertex from a plane */
    double crease; /* tangent of the angle; INFINITY: no angle */
} smooth_check;

/* Whether a place lies in the plane across `normal` through another place, up to rounding. */
static bool is_in_plane(const smooth_check *k, vec3 normal, vec3 through, vec3 x)
{
    const double up = vec3_dot(vec3_sub(x, through), normal);
    return up * up <= k->reach * k->reach * vec3_norm2(normal);
}

/* The corner of a triangle that is not at its side between a and b. */
static unsigned opposite(const uint32_t *t, uint32_t a, uint32_t b)
{
    return t[0] != a && t[0] != b ? 0 : t[1] != a && t[1] != b ? 1 : 2;
}

/* The bits of side k of triangle n with the normal `own`. The same for both triangles of a side, to the last bit. */
static unsigned bits_of(const smooth_check *job, size_t n, int k, vec3 own)
{
    const smooth_sides *s = job->s;
    const uint32_t next = s->beside[n][k];
    if (next == NO_TRIANGLE) return SMOOTH_SIDES_CREASE;
    const uint32_t *t = s->m->triangle[n], a = t[k], b = t[k < 2 ? k + 1 : 0], far = t[k > 0 ? k - 1 : 2];
    const vec3 *v = s->m->vertex, other = mesh_across(s->m, next);
    const uint32_t *u = s->m->triangle[next];
    const unsigned across = opposite(u, a, b), shared = (across + 1) % 3;
    const bool is_reversed = u[shared] == a;
    const unsigned bits = shared | (is_reversed ? SMOOTH_SIDES_REVERSED : 0);
    const double cosine = (is_reversed ? -1 : 1) * vec3_dot(own, other),
                 sine = vec3_norm(vec3_cross(own, other));
    if (isfinite(job->crease) && !(sine <= job->crease * cosine)) return SMOOTH_SIDES_CREASE;
    if (!(cosine > 0)) return bits;
    const vec3 common = v[a < b ? a : b];
    return sine <= FLAT_ANGLE * cosine || is_in_plane(job, own, common, v[u[across]]) ||
                   is_in_plane(job, other, common, v[far])
               ? bits | SMOOTH_SIDES_COPLANAR
               : bits;
}

static void mark_chunk(void *context, int worker, size_t begin, size_t end)
{
    const smooth_check *job = context;
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        const vec3 own = mesh_across(job->s->m, n);
        for (int k = 0; k < 3; k++) job->s->bits[n][k] = (uint8_t)bits_of(job, n, k, own);
    }
}

bool smooth_sides_make(const mesh *m, const uint32_t (*beside)[3], double crease, threads *pool,
                       smooth_sides *out, error *e)
{
    *out = (smooth_sides){.m = m, .beside = beside};
    out->bits = mem_array(m->triangle_count, sizeof *out->bits, what, e);
    out->corner = mem_array(m->triangle_count, sizeof *out->corner, what, e);
    if (!out->bits || !out->corner || (!beside && !list_neighbours(out, pool, e))) return false;
    const rounding r = rounding_of(m, pool);
    const bbox box = mesh_box(m, pool);
    const smooth_check job = {out, rounding_reach(&r, (const vec3[]){box.min, box.max, box.max}),
                              isfinite(crease) ? elementary_tan(crease) : INFINITY};
    threads_run(pool, m->triangle_count, GRAIN, mark_chunk, (void *)&job);
    return threads_may_go_on(pool, e);
}

void smooth_sides_free(smooth_sides *s)
{
    free(s->own);
    free(s->bits);
    free(s->corner);
    *s = (smooth_sides){0};
}

sector_step sector_first(const smooth_sides *s, uint32_t triangle, int corner, bool *is_closed)
{
    sector_step at = sector_begin(s, triangle, corner, false);
    *is_closed = false;
    for (int step = 0; step < SECTOR_MOST && !*is_closed && sector_next(s, &at); step++)
        *is_closed = at.triangle == triangle;
    if (*is_closed) return sector_begin(s, triangle, corner, true);
    const bool is_reversed = at.is_reversed, was_ahead = at.side == at.corner;
    at = sector_begin(s, at.triangle, at.corner, !was_ahead);
    at.is_reversed = is_reversed;
    return at;
}

static void add_bend(sector_bends *b, uint32_t far)
{
    if (b->count < 2) b->far[b->count] = far;
    if (b->count < SECTOR_BENDS_MOST) b->count++;
}

sector_bends sector_find_bends(const smooth_sides *s, uint32_t triangle, int corner)
{
    sector_bends out = {.count = 0};
    sector_step at = sector_first(s, triangle, corner, &out.is_closed);
    const uint32_t first = at.triangle;
    if (!out.is_closed) {
        const sector_step end = sector_begin(s, at.triangle, at.corner, at.side != at.corner);
        add_bend(&out, end.far);
    }
    for (int step = 0; step < SECTOR_MOST && out.count < SECTOR_BENDS_MOST; step++) {
        if (!sector_is_coplanar(s, &at)) add_bend(&out, at.far);
        if (!sector_next(s, &at) || at.triangle == first) break;
    }
    return out;
}

static bool find_is_corner(const smooth_sides *s, uint32_t triangle, int corner)
{
    const sector_bends b = sector_find_bends(s, triangle, corner);
    if (b.count != 2) return b.count > 0;
    const vec3 *v = s->m->vertex, at = v[s->m->triangle[triangle][corner]], one = vec3_sub(v[b.far[0]], at),
               two = vec3_sub(v[b.far[1]], at);
    return !(vec3_norm2(vec3_cross(one, two)) <= STRAIGHT * STRAIGHT * vec3_norm2(one) * vec3_norm2(two) &&
             vec3_dot(one, two) < 0);
}

bool sector_is_corner(const smooth_sides *s, uint32_t triangle, int corner)
{
    enum { UNKNOWN, NO, YES };
    if (!smooth_sides_has_coplanar(s, triangle)) return true;
    uint8_t *kept = &s->corner[triangle][corner], known = __atomic_load_n(kept, __ATOMIC_RELAXED);
    if (known == UNKNOWN) {
        known = find_is_corner(s, triangle, corner) ? YES : NO;
        __atomic_store_n(kept, known, __ATOMIC_RELAXED);
    }
    return known == YES;
}

sector_step sector_follow(const smooth_sides *s, sector_step at)
{
    for (int step = 0; step < CHAIN_MOST; step++) {
        const int k = sector_far_corner(&at);
        const bool begins_here = at.side == k, is_reversed = at.is_reversed;
        /* at `far`, the other side of the triangle */
        at = sector_begin(s, at.triangle, k, !begins_here);
        at.is_reversed = is_reversed;
        if (sector_is_corner(s, at.triangle, k)) break;
        while (sector_is_coplanar(s, &at) && sector_next(s, &at)) {
        }
    }
    return at;
}
