// SPDX-License-Identifier: Apache-2.0
#include "surface/remesh/geodesic_cells.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/heap.h"
#include "base/core/memory.h"
#include "surface/triangles/triangle_tree.h"

static const char what[] = "the cells of the points";

typedef struct cell_growth {
    const fine_mesh *f;
    double *distance;         /* per vertex: the least candidate distance so far, INFINITY if there is none */
    uint32_t *offered, *name; /* per vertex: the point of this candidate; the point of the cell once the
                               * vertex is final */
    heap candidates;          /* vertices, `of` points; key: the distance of both */
} cell_growth;

/* ---- propagation ---- */

/* The distance of w from a point whose distances from u and v are from_u and from_v, with the triangle
 * unfolded into the plane. */
static double distance_across(vec3 u, double from_u, vec3 v, double from_v, vec3 w)
{
    const vec3 along = vec3_sub(v, u), to = vec3_sub(w, u);
    const double length = vec3_norm(along),
                 straight = fmin(from_u + vec3_norm(to), from_v + vec3_norm(vec3_sub(w, v)));
    if (!(length > 0)) return straight;
    const double x = (from_u * from_u - from_v * from_v + length * length) / (2 * length),
                 y = sqrt(fmax(from_u * from_u - x * x, 0)), wx = vec3_dot(to, along) / length,
                 wy = sqrt(fmax(vec3_norm2(to) - wx * wx, 0)),
                 crossing = x + (wx - x) * y / fmax(y + wy, 1e-300);
    return crossing >= 0 && crossing <= length ? sqrt((wx - x) * (wx - x) + (wy + y) * (wy + y)) : straight;
}

/* Pushes a candidate if it is better than the previous candidates of its vertex. Worse candidates in the
 * heap are skipped later, because the vertex is final then. */
static bool offer(cell_growth *g, heap_item r, error *e)
{
    const uint32_t v = r.item;
    if (r.key > g->distance[v] || (r.key == g->distance[v] && r.of >= g->offered[v])) return true;
    g->distance[v] = r.key;
    g->offered[v] = r.of;
    return heap_push(&g->candidates, r, what, e);
}

/* Pushes candidates for the neighbours of v, which has just become final, across its triangles. */
static bool look_around(cell_growth *g, uint32_t v, error *e)
{
    const mesh *m = &g->f->m;
    for (size_t k = g->f->first[v]; k < g->f->first[v + 1]; k++) {
        const uint32_t *t = m->triangle[g->f->around[k]];
        const int at = t[0] == v ? 0 : t[1] == v ? 1 : 2;
        for (int side = 1; side < 3; side++) {
            const uint32_t to = t[(at + side) % 3], beside = t[(at + 3 - side) % 3];
            if (g->name[to] != GEODESIC_CELLS_NONE) continue;
            const double d = g->name[beside] == g->name[v]
                                 ? distance_across(m->vertex[v], g->distance[v], m->vertex[beside],
                                                   g->distance[beside], m->vertex[to])
                                 : g->distance[v] + vec3_norm(vec3_sub(m->vertex[to], m->vertex[v]));
            if (!offer(g, (heap_item){d, to, g->name[v]}, e)) return false;
        }
    }
    return true;
}

/* Pushes each point as a candidate for the corners of its triangle. */
static bool begin(cell_growth *g, size_t count, const vec3 *position, const uint32_t *name, error *e)
{
    const mesh *m = &g->f->m;
    triangle_tree *tree = triangle_tree_new(m, NULL, e);
    bool ok = tree != NULL;
    for (size_t i = 0; ok && i < count; i++) {
        double weight[3];
        const uint32_t *t = m->triangle[triangle_tree_find(tree, position[i], weight)];
        for (int k = 0; ok && k < 3; k++)
            ok = offer(g, (heap_item){vec3_norm(vec3_sub(m->vertex[t[k]], position[i])), t[k], name[i]}, e);
    }
    triangle_tree_free(tree);
    return ok;
}

bool geodesic_cells_grow(const fine_mesh *f, size_t count, const vec3 *position, const uint32_t *name,
                         uint32_t **out, error *e)
{
    cell_growth g = {.f = f,
                     .distance = mem_array(f->m.vertex_count, sizeof *g.distance, what, e),
                     .offered = mem_array(f->m.vertex_count, sizeof *g.offered, what, e),
                     .name = mem_array(f->m.vertex_count, sizeof *g.name, what, e)};
    bool ok = g.distance && g.offered && g.name;
    for (size_t v = 0; ok && v < f->m.vertex_count; v++) {
        g.distance[v] = INFINITY;
        g.name[v] = GEODESIC_CELLS_NONE;
    }
    ok = ok && begin(&g, count, position, name, e);
    while (ok && g.candidates.count > 0) {
        const heap_item r = heap_pop(&g.candidates);
        if (g.name[r.item] != GEODESIC_CELLS_NONE) continue;
        g.name[r.item] = r.of;
        ok = look_around(&g, r.item, e);
    }
    free(g.candidates.item);
    free(g.distance);
    free(g.offered);
    if (ok)
        *out = g.name;
    else
        free(g.name);
    return ok;
}
