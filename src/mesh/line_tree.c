#include "mesh/line_tree.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "geometry/bbox.h"

/* Maximum number of triangles in a leaf. */
#define LEAF_MOST 8
/* Capacity of the search stack. Nodes are halved by number of triangles, so that it suffices for 2^32 of them. */
#define DEEPEST 40

typedef struct node {
    bbox box;
    uint32_t first,
        count; /* a leaf has the triangles list[first] .. list[first + count - 1]; another node has count 0 and the children first, first + 1 */
} node;

struct line_tree {
    const mesh *m;
    uint32_t *list;
    node *nodes;
    uint32_t node_count;
};

typedef struct placed {
    double at;
    uint32_t triangle;
} placed;

static int by_place(const void *left, const void *right)
{
    const placed *a = left, *b = right;
    if (a->at != b->at) return a->at < b->at ? -1 : 1;
    return (a->triangle > b->triangle) - (a->triangle < b->triangle);
}

static vec3 corner_of(const mesh *m, uint32_t n, int k)
{
    return m->vertex[m->triangle[n][k]];
}

static vec3 middle_of(const mesh *m, uint32_t n)
{
    return vec3_scale(vec3_add(corner_of(m, n, 0), vec3_add(corner_of(m, n, 1), corner_of(m, n, 2))),
                      1.0 / 3);
}

static int longest_axis(bbox b)
{
    const vec3 d = vec3_sub(b.max, b.min);
    return d.x >= d.y && d.x >= d.z ? 0 : d.y >= d.z ? 1 : 2;
}

/* Builds node `at` over list[first] .. list[first + count - 1]. */
static void build(line_tree *t, uint32_t at, uint32_t first, uint32_t count, placed *scratch)
{
    bbox box = bbox_empty(), middles = bbox_empty();
    for (uint32_t k = first; k < first + count; k++) {
        for (int c = 0; c < 3; c++) box = bbox_include(box, corner_of(t->m, t->list[k], c));
        middles = bbox_include(middles, middle_of(t->m, t->list[k]));
    }
    t->nodes[at] = (node){box, first, count};
    if (count <= LEAF_MOST) return;
    const int axis = longest_axis(middles);
    for (uint32_t k = 0; k < count; k++) {
        uint32_t n = t->list[first + k];
        scratch[k] = (placed){vec3_get(middle_of(t->m, n), axis), n};
    }
    qsort(scratch, count, sizeof *scratch, by_place);
    for (uint32_t k = 0; k < count; k++) t->list[first + k] = scratch[k].triangle;
    const uint32_t child = t->node_count, half = count / 2;
    t->node_count += 2;
    t->nodes[at] = (node){box, child, 0};
    build(t, child, first, half, scratch);
    build(t, child + 1, first + half, count - half, scratch);
}

line_tree *line_tree_new(const mesh *m, error *e)
{
    static const char what[] = "the tree of the mesh's triangles";
    line_tree *t = mem_alloc(sizeof *t);
    const size_t count = m->triangle_count;
    t->m = m;
    t->list = mem_array(count, sizeof *t->list, what, e);
    t->nodes =
        t->list ? mem_array(count + 2, sizeof *t->nodes, what, e) : NULL; /* leaves hold four or more */
    placed *scratch = t->nodes ? mem_array(count, sizeof *scratch, what, e) : NULL;
    if (!scratch) {
        line_tree_free(t);
        return NULL;
    }
    for (uint32_t n = 0; n < count; n++) t->list[n] = n;
    t->node_count = 1;
    build(t, 0, 0, (uint32_t)count, scratch);
    free(scratch);
    return t;
}

void line_tree_free(line_tree *t)
{
    if (!t) return;
    free(t->list);
    free(t->nodes);
    free(t);
}

size_t line_tree_bytes(const line_tree *t)
{
    return t ? t->m->triangle_count * (sizeof *t->list + sizeof *t->nodes) : 0;
}

static bool meets(const bbox *b, vec3 p, vec3 d)
{
    double low = -INFINITY, high = INFINITY;
    for (int axis = 0; axis < 3; axis++) {
        double o = vec3_get(p, axis), way = vec3_get(d, axis);
        double from = vec3_get(b->min, axis), to = vec3_get(b->max, axis);
        if (way == 0) {
            if (o < from || o > to) return false;
            continue;
        }
        double a = (from - o) / way, c = (to - o) / way;
        low = fmax(low, fmin(a, c));
        high = fmin(high, fmax(a, c));
    }
    return low <= high;
}

/* Source: Moeller and Trumbore 1997, "Fast, Minimum Storage Ray/Triangle Intersection". */
static void cross_triangle(const mesh *m, uint32_t n, vec3 p, vec3 d, line_crossings *out)
{
    const vec3 a = corner_of(m, n, 0), ab = vec3_sub(corner_of(m, n, 1), a),
               ac = vec3_sub(corner_of(m, n, 2), a);
    const vec3 q = vec3_cross(d, ac), from = vec3_sub(p, a);
    const double det = vec3_dot(ab, q), u = vec3_dot(from, q) / det;
    if (!(u >= 0 && u <= 1)) return; /* true also for a parallel triangle */
    const vec3 r = vec3_cross(from, ab);
    const double v = vec3_dot(d, r) / det, at = vec3_dot(ac, r) / det;
    if (!(v >= 0 && u + v <= 1)) return;
    if (at < 0) {
        out->behind = fmin(out->behind, -at);
        return;
    }
    out->ahead = fmin(out->ahead, at);
    out->winding += det < 0 ? 1 : -1; /* det = -d . normal */
}

line_crossings line_tree_cross(const line_tree *t, vec3 p, vec3 d, uint32_t skip)
{
    line_crossings out = {INFINITY, INFINITY, 0};
    uint32_t waiting[DEEPEST], count = 1;
    waiting[0] = 0;
    while (count > 0) {
        const node *n = &t->nodes[waiting[--count]];
        if (!meets(&n->box, p, d)) continue;
        if (n->count == 0) {
            waiting[count++] = n->first;
            waiting[count++] = n->first + 1;
            continue;
        }
        for (uint32_t k = n->first; k < n->first + n->count; k++)
            if (t->list[k] != skip) cross_triangle(t->m, t->list[k], p, d, &out);
    }
    return out;
}
