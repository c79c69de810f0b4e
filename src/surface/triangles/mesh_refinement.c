// SPDX-License-Identifier: Apache-2.0
#include "surface/triangles/mesh_refinement.h"

#include <stdlib.h>

#include "geometry/mesh/mesh_weld.h"
#include "base/core/memory.h"
#include "geometry/space/triangle.h"
#include "geometry/mesh/mesh_edges.h"

static const char what[] = "the refined triangles of the mesh";

#define NONE UINT32_MAX

/* Sine of the angle between a triangle's normal and a vertex normal. With larger angles, particles on
 * large triangles converge slowly. */
static const double least_bend = 0.1;

/* One round: edges that are too long get a vertex at their midpoint. */
typedef struct halving {
    const mesh *m;
    uint32_t (*middle)[3];      /* per triangle: the new vertex on the edge from corner k, or NONE */
    size_t vertices, triangles; /* of the refined mesh */
} halving;

static vec3 middle_of(const mesh *m, uint32_t a, uint32_t b)
{
    return vec3_scale(vec3_add(m->vertex[a], m->vertex[b]), 0.5);
}

/* The corner of its triangle at which side `s` of an edge begins; v: the lower vertex of the edge. A triangle
 * in which two vertices are joined has two sides that begin at the same vertex. */
static int begins_at(const mesh *m, const mesh_side *s, uint32_t v)
{
    const uint32_t from = s->upwards ? v : s->other, to = s->upwards ? s->other : v,
                   *t = m->triangle[s->triangle];
    int k = 0;
    while (k < 2 && !(t[k] == from && t[k + 1] == to)) k++;
    return k;
}

/* The vertices of the edge of a triangle from corner k, the lesser first. */
static void side_vertices(const mesh *m, const mesh_side *s, int k, uint32_t out[2])
{
    const uint32_t *t = m->triangle[s->triangle], a = t[k], b = t[(k + 1) % 3];
    out[0] = a < b ? a : b;
    out[1] = a < b ? b : a;
}

/* Whether a vertex normal differs from the normal of the triangle. Its sign is ignored, because it is
 * arbitrary on a one-sided surface. */
static bool is_bent(const mesh *m, const vec3 *normal, size_t n)
{
    const uint32_t *t = m->triangle[n];
    const vec3 own = vec3_unit(mesh_across(m, n));
    bool bent = false;
    for (int k = 0; k < 3; k++) bent |= vec3_norm(vec3_cross(own, normal[t[k]])) > least_bend;
    return bent;
}

static bool is_long(const mesh *m, double longest, uint32_t a, uint32_t b)
{
    return vec3_norm2(vec3_sub(m->vertex[a], m->vertex[b])) > longest * longest;
}

static bool has_long_side(const mesh *m, double longest)
{
    bool found = false;
    for (size_t n = 0; n < m->triangle_count && !found; n++)
        for (int k = 0; k < 3; k++)
            found |= is_long(m, longest, m->triangle[n][k], m->triangle[n][(k + 1) % 3]);
    return found;
}

/* The new vertex of side k of an edge: that of an earlier side with the same vertices, or a new one. Patches
 * that meet in an edge have different vertices at the same positions. */
static uint32_t middle_vertex(halving *h, const mesh_edges *edges, size_t first, size_t k, uint32_t v,
                              const mesh *joined)
{
    const mesh_side *side = edges->sides + first;
    uint32_t own[2], other[2];
    side_vertices(h->m, &side[k], begins_at(joined, &side[k], v), own);
    for (size_t j = 0; j < k; j++) {
        const int at = begins_at(joined, &side[j], v);
        side_vertices(h->m, &side[j], at, other);
        if (own[0] == other[0] && own[1] == other[1]) return h->middle[side[j].triangle][at];
    }
    return (uint32_t)h->vertices++;
}

/* Marks the edges to be halved. `joined`: the mesh with one vertex at each position, so that an edge is
 * halved in all patches or in none. */
static void mark_sides(halving *h, const mesh *joined, const mesh_edges *edges, const vec3 *normal,
                       double longest)
{
    for (uint32_t v = 0; v < edges->vertex_count; v++)
        for (size_t i = edges->first[v], n; i < edges->first[v + 1]; i += n) {
            const mesh_side *side = edges->sides + i;
            n = mesh_edges_width(edges, v, i);
            bool halved = false;
            for (size_t j = 0; j < n && is_long(joined, longest, v, side->other); j++)
                halved |= is_bent(h->m, normal, side[j].triangle);
            for (size_t j = 0; j < n; j++)
                h->middle[side[j].triangle][begins_at(joined, &side[j], v)] =
                    halved ? middle_vertex(h, edges, i, j, v, joined) : NONE;
            h->triangles += halved ? n : 0;
        }
}

static bool find_middles(halving *h, const vec3 *normal, double longest, threads *pool, error *e)
{
    mesh joined = {0};
    mesh_edges edges = {0};
    const bool ok = mesh_copy(h->m, pool, &joined, e) && mesh_weld_vertices(&joined, pool, e) &&
                    mesh_edges_list(&joined, pool, &edges, e);
    /* sides that no edge has: of triangles whose vertices are all joined */
    for (size_t n = 0; ok && n < h->m->triangle_count; n++)
        for (int k = 0; k < 3; k++) h->middle[n][k] = NONE;
    if (ok) mark_sides(h, &joined, &edges, normal, longest);
    mesh_edges_free(&edges);
    mesh_free(&joined);
    return ok;
}

/* before, after: the arrays *whole of mesh_refine. */
static void fill(const halving *h, mesh *out, size_t *first, size_t count, const uint32_t *before,
                 uint32_t *after)
{
    size_t to = 0, group = 0;
    for (size_t v = 0; v < h->m->vertex_count; v++) out->vertex[v] = h->m->vertex[v];
    for (size_t n = 0; n < h->m->triangle_count; n++) {
        for (; group <= count && first[group] == n; group++) first[group] = to;
        const uint32_t *t = h->m->triangle[n];
        uint32_t corner[6] = {t[0], t[1], t[2]};
        for (int k = 0; k < 3; k++)
            if ((corner[3 + k] = h->middle[n][k]) != NONE)
                out->vertex[corner[3 + k]] = middle_of(h->m, t[k], t[(k + 1) % 3]);
        const bool halved[3] = {corner[3] != NONE, corner[4] != NONE, corner[5] != NONE};
        int parts[4][3];
        const int made = triangle_split(halved, parts);
        for (int i = 0; i < made; i++, to++) {
            for (int k = 0; k < 3; k++) out->triangle[to][k] = corner[parts[i][k]];
            after[to] = before ? before[n] : (uint32_t)n;
        }
    }
    for (; group <= count; group++) first[group] = to;
}

bool mesh_refine(mesh *m, const vec3 *normal, double longest, size_t most, size_t *first, size_t count,
                 uint32_t **whole, bool *changed, threads *pool, error *e)
{
    uint32_t *parts_of = NULL;
    halving h = {.m = m, .vertices = m->vertex_count, .triangles = m->triangle_count};
    mesh out = {0};
    *changed = false;
    if (!has_long_side(m, longest)) return true;
    h.middle = mem_array(m->triangle_count, sizeof *h.middle, what, e);
    bool ok = h.middle && find_middles(&h, normal, longest, pool, e);
    *changed = ok && h.triangles > m->triangle_count && h.triangles <= most;
    if (*changed) {
        out = (mesh){h.vertices, h.triangles, mem_array(h.vertices, sizeof *out.vertex, what, e),
                     mem_array(h.triangles, sizeof *out.triangle, what, e), false};
        parts_of = mem_array(h.triangles, sizeof *parts_of, what, e);
        ok = out.vertex && out.triangle && parts_of;
    }
    if (ok && *changed) {
        fill(&h, &out, first, count, *whole, parts_of);
        mesh_free(m);
        free(*whole);
        *m = out;
        *whole = parts_of;
    } else {
        mesh_free(&out);
        free(parts_of);
    }
    free(h.middle);
    return ok;
}
