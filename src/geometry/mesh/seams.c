// SPDX-License-Identifier: Apache-2.0
#include "geometry/mesh/seams.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "geometry/mesh/rounding.h"
#include "geometry/space/box_tree.h"

/* Factor on the distances of searches, so that rounding excludes no vertex. */
static const double SEARCH_MARGIN = 1.0001;

static const char what[] = "the open edges of the mesh";

/* Vertices are joined at most at this fraction of the shortest edge at either of them, beside the rounding of their
 * coordinates: whatever the size of the whole mesh is, joining does not change the shape of a part. */
static const double of_shortest_edge = 0.1;

/* A vertex of open edges. */
typedef struct end {
    double x;
    uint32_t vertex;
} end;

/* A vertex on an edge. */
typedef struct cut {
    uint32_t edge, vertex;
    double at; /* position along the edge, 0 at its start and 1 at its end */
} cut;

typedef struct cutting {
    mesh *m;
    const seam_edge *edges;
    size_t count;
    double tolerance;
    double *
        local; /* per vertex of open edges: distance up to which its own edges and coordinates permit joining */
    end *ends;
    size_t end_count;
    cut *cuts;
    size_t cut_count, cut_room;
    bool *taken; /* per triangle: one of its edges is cut */
} cutting;

static int by_x(const void *left, const void *right)
{
    const end *a = left, *b = right;
    if (a->x != b->x) return a->x < b->x ? -1 : 1;
    return (a->vertex > b->vertex) - (a->vertex < b->vertex);
}

static int by_edge(const void *left, const void *right)
{
    const cut *a = left, *b = right;
    if (a->edge != b->edge) return a->edge < b->edge ? -1 : 1;
    if (a->at != b->at) return a->at < b->at ? -1 : 1;
    return (a->vertex > b->vertex) - (a->vertex < b->vertex);
}

static bool list_ends(cutting *c, error *e)
{
    c->ends = mem_array(2 * c->count, sizeof *c->ends, what, e);
    if (!c->ends) return false;
    for (size_t k = 0; k < 2 * c->count; k++) {
        uint32_t v = k & 1 ? c->edges[k / 2].to : c->edges[k / 2].from;
        c->ends[k] = (end){c->m->vertex[v].x, v};
    }
    qsort(c->ends, 2 * c->count, sizeof *c->ends, by_x);
    for (size_t k = 0; k < 2 * c->count; k++)
        if (k == 0 || c->ends[k].vertex != c->ends[k - 1].vertex) c->ends[c->end_count++] = c->ends[k];
    return true;
}

/* Sets c->local. Its other elements are negative. */
static bool measure_edges(cutting *c, error *e)
{
    const mesh *m = c->m;
    c->local = mem_array(m->vertex_count, sizeof *c->local, what, e);
    if (!c->local) return false;
    for (uint32_t v = 0; v < m->vertex_count; v++) c->local[v] = -1;
    for (size_t k = 0; k < c->end_count; k++) c->local[c->ends[k].vertex] = INFINITY;
    for (size_t n = 0; n < m->triangle_count; n++)
        for (int k = 0; k < 3; k++) {
            const uint32_t a = m->triangle[n][k], b = m->triangle[n][(k + 1) % 3];
            if (c->local[a] < 0 && c->local[b] < 0) continue;
            const double side = vec3_norm(vec3_sub(m->vertex[a], m->vertex[b]));
            if (side < c->local[a]) c->local[a] = side;
            if (side < c->local[b]) c->local[b] = side;
        }
    const rounding r = rounding_of(m, NULL);
    for (size_t k = 0; k < c->end_count; k++) {
        const uint32_t v = c->ends[k].vertex;
        c->local[v] = of_shortest_edge * c->local[v] +
                      2 * sqrt(3) * (r.absolute + r.relative * rounding_largest_coordinate(m->vertex[v]));
    }
    return true;
}

bool seams_join(mesh *m, const seam_edge *edges, size_t count, double tolerance, size_t *joined, error *e)
{
    cutting c = {.m = m, .edges = edges, .count = count, .tolerance = tolerance};
    if (count == 0) return true;
    uint32_t *to = mem_array(m->vertex_count, sizeof *to, what, e);
    bool ok = to && list_ends(&c, e) && measure_edges(&c, e);
    for (uint32_t v = 0; ok && v < m->vertex_count; v++) to[v] = v;
    for (size_t k = 0; ok && k < c.end_count; k++) {
        const end *a = &c.ends[k];
        const double within = fmin(tolerance, c.local[a->vertex]);
        for (size_t n = k; n > 0 && a->x - c.ends[n - 1].x <= within; n--) {
            const uint32_t b = c.ends[n - 1].vertex;
            const double apart = vec3_norm(vec3_sub(m->vertex[a->vertex], m->vertex[b]));
            if (to[b] != b || apart > fmin(within, c.local[b])) continue;
            to[a->vertex] = b;
            ++*joined;
            break;
        }
    }
    for (size_t n = 0; ok && n < m->triangle_count; n++)
        for (int k = 0; k < 3; k++) m->triangle[n][k] = to[m->triangle[n][k]];
    if (ok) mesh_drop_degenerate(m);
    m->welded &= *joined == 0;
    free(to);
    free(c.ends);
    free(c.local);
    return ok;
}

static bool add_cut(cutting *c, cut added, error *e)
{
    if (!MEM_GROW(c->cuts, c->cut_count, &c->cut_room, what, e)) return false;
    c->cuts[c->cut_count++] = added;
    return true;
}

/* The search for the vertices on an edge. */
typedef struct search {
    cutting *c;
    uint32_t edge;
    vec3 a, way;   /* start of the edge, and the vector from its start to its end */
    double within; /* largest distance of a vertex from the edge */
    bool ok;
    error *e;
} search;

static void cut_at_end(search *f, uint32_t k)
{
    cutting *c = f->c;
    const uint32_t triangle = c->edges[f->edge].triangle, *t = c->m->triangle[triangle],
                   v = c->ends[k].vertex;
    const double length = vec3_norm(f->way);
    const vec3 from = vec3_sub(c->m->vertex[v], f->a);
    const double at = vec3_dot(from, f->way) / (length * length), within = fmin(f->within, c->local[v]);
    if (!f->ok || v == t[0] || v == t[1] || v == t[2] ||
        !(at * length > within && (1 - at) * length > within) ||
        vec3_norm(vec3_axpy(-at, f->way, from)) > within)
        return;
    f->ok = add_cut(c, (cut){f->edge, v, at}, f->e);
    c->taken[triangle] = true;
}

/* A cube around an end that contains all places at which an edge may have it as a vertex. */
static bbox box_of_end(const void *context, uint32_t k)
{
    const cutting *c = context;
    const uint32_t v = c->ends[k].vertex;
    const vec3 x = c->m->vertex[v];
    return bbox_grow((bbox){x, x}, SEARCH_MARGIN * fmin(c->tolerance, c->local[v]));
}

/* Tests the ends whose cubes the edge meets. */
static bool cut_edge(cutting *c, const box_tree *ends, uint32_t n, error *e)
{
    const seam_edge *s = &c->edges[n];
    const vec3 a = c->m->vertex[s->from];
    const double within = fmin(c->tolerance, fmax(c->local[s->from], c->local[s->to]));
    search f = {c, n, a, vec3_sub(c->m->vertex[s->to], a), within, true, e};
    const double length = vec3_norm(f.way);
    if (c->taken[s->triangle] || !(length > 0)) return true;
    const box_tree_ray ray = box_tree_ray_make(ends, a, vec3_scale(f.way, 1 / length));
    box_tree_walk w;
    box_tree_begin_ray(ends, &w, &ray, length);
    while (box_tree_next_on_ray(ends, &w, &ray, length))
        for (size_t k = w.first; k < w.end; k++) cut_at_end(&f, ends->order[k]);
    return f.ok;
}

static bool cut_edges(cutting *c, error *e)
{
    vec3 *place = mem_array(c->end_count, sizeof *place, what, e);
    for (size_t k = 0; place && k < c->end_count; k++) place[k] = c->m->vertex[c->ends[k].vertex];
    box_tree ends = {0};
    bool ok = place && box_tree_make(c->end_count, place, box_of_end, c, NULL, what, &ends, e);
    for (uint32_t n = 0; ok && n < c->count; n++) ok = cut_edge(c, &ends, n, e);
    box_tree_free(&ends);
    free(place);
    return ok;
}

/* Replaces each triangle that has n cuts on an edge by a fan of n + 1 triangles about the corner opposite to
 * the edge. */
static bool split_all(cutting *c, size_t *split, error *e)
{
    mesh *m = c->m;
    uint32_t(*larger)[3] = mem_array(m->triangle_count + c->cut_count, sizeof *larger, what, e);
    if (!larger) return false;
    memcpy(larger, m->triangle, m->triangle_count * sizeof *larger);
    free(m->triangle);
    m->triangle = larger;
    m->welded = false;
    for (size_t k = 0; k < c->cut_count; k++) {
        const seam_edge *s = &c->edges[c->cuts[k].edge];
        uint32_t *t = larger[s->triangle];
        const bool first = k == 0 || c->cuts[k - 1].edge != c->cuts[k].edge;
        while (t[1] != s->to) { /* rotate the corners until the edge's end is the second one */
            const uint32_t corner = t[0];
            t[0] = t[1];
            t[1] = t[2];
            t[2] = corner;
        }
        uint32_t *added = larger[m->triangle_count++]; /* the piece before the cut */
        added[0] = t[0];
        added[1] = c->cuts[k].vertex;
        added[2] = t[2];
        t[0] = c->cuts[k].vertex;
        *split += first;
    }
    return true;
}

bool seams_split(mesh *m, const seam_edge *edges, size_t count, double tolerance, size_t *split, error *e)
{
    cutting c = {.m = m, .edges = edges, .count = count, .tolerance = tolerance};
    if (count == 0 || !(tolerance > 0)) return true;
    c.taken = mem_array(m->triangle_count, sizeof *c.taken, what, e);
    bool ok = c.taken && list_ends(&c, e) && measure_edges(&c, e) && cut_edges(&c, e);
    if (ok && c.cut_count) {
        qsort(c.cuts, c.cut_count, sizeof *c.cuts, by_edge);
        ok = split_all(&c, split, e);
    }
    free(c.ends);
    free(c.local);
    free(c.cuts);
    free(c.taken);
    return ok;
}
