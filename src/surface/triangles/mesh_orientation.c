// SPDX-License-Identifier: Apache-2.0
#include "surface/triangles/mesh_orientation.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/mesh/orientation.h"

static const char what[] = "the orientation of the mesh";

/* Directions of the rays that decide, by majority, whether a part lies inside another one. None is
 * parallel to an axis or to a usual edge. */
enum { RAYS = 3 };
static const vec3 RAY[RAYS] = {
    {0.5377, 0.2896, 0.7917}, {-0.6412, 0.7431, 0.1915}, {0.1873, -0.5921, 0.7838}};

/* ---- edges at which patches end */

/* A boundary edge of a patch, from the end whose coordinates come first. */
typedef struct open_edge {
    vec3 from, to;
    uint32_t patch;
    bool forwards; /* its triangle has it in the direction from `from` to `to` */
} open_edge;

static int compare_edges(const void *a, const void *b)
{
    const open_edge *p = a, *q = b;
    const int from = vec3_compare(p->from, q->from), to = vec3_compare(p->to, q->to);
    return from != 0 ? from : to != 0 ? to : p->patch < q->patch ? -1 : p->patch > q->patch;
}

static void add_open_edge(const mesh_patches *p, const mesh_side *s, uint32_t low, uint32_t patch,
                          open_edge *out)
{
    const vec3 a = p->m.vertex[low], b = p->m.vertex[s->other];
    const bool swap = vec3_compare(a, b) > 0;
    *out = (open_edge){swap ? b : a, swap ? a : b, patch, swap != (bool)s->upwards};
}

static uint32_t patch_of(const mesh_patches *p, size_t triangle)
{
    size_t low = 0, high = p->count;
    while (high - low > 1) *(p->first[(low + high) / 2] <= triangle ? &low : &high) = (low + high) / 2;
    return (uint32_t)low;
}

/* Lists the boundary edges, sorted by position; free the result. Vertices belong to one patch, so that a
 * patch ends at edges of one triangle. */
static open_edge *list_open_edges(const mesh_patches *p, size_t *count, error *e)
{
    mesh_edges edges = {0};
    open_edge *out = NULL;
    *count = 0;
    if (mesh_edges_list(&p->m, NULL, &edges, e) && (out = mem_array(edges.open, sizeof *out, what, e)))
        for (uint32_t v = 0; v < edges.vertex_count; v++)
            for (size_t i = edges.first[v], n; i < edges.first[v + 1]; i += n) {
                n = mesh_edges_width(&edges, v, i);
                const mesh_side *s = &edges.sides[i];
                if (n == 1) add_open_edge(p, s, v, patch_of(p, s->triangle), &out[(*count)++]);
            }
    mesh_edges_free(&edges);
    if (out) qsort(out, *count, sizeof *out, compare_edges);
    return out;
}

/* ---- parts: patches that meet in edges of two triangles */

typedef struct parts {
    const mesh_patches *p;
    orientation joined; /* of the patches */
    uint32_t *root;     /* per patch: the representative patch of its part */
    bool *turned;       /* per patch */
    bool *is_closed;    /* per root: an even number of triangles meets at each edge */
    double *volume;     /* per root, with the patches turned */
    bbox *box;          /* per root */
} parts;

static void free_parts(parts *s)
{
    orientation_free(&s->joined);
    free(s->root);
    free(s->turned);
    free(s->is_closed);
    free(s->volume);
    free(s->box);
}

static bool allocate_parts(const mesh_patches *p, parts *s, error *e)
{
    *s = (parts){.p = p};
    s->root = mem_array(p->count, sizeof *s->root, what, e);
    s->turned = mem_array(p->count, sizeof *s->turned, what, e);
    s->is_closed = mem_array(p->count, sizeof *s->is_closed, what, e);
    s->volume = mem_array(p->count, sizeof *s->volume, what, e);
    s->box = mem_array(p->count, sizeof *s->box, what, e);
    return orientation_init(&s->joined, p->count, e) && s->root && s->turned && s->is_closed && s->volume &&
           s->box;
}

static size_t end_of_edge(const open_edge *edge, size_t count, size_t k)
{
    size_t next = k + 1;
    while (next < count && vec3_compare(edge[next].from, edge[k].from) == 0 &&
           vec3_compare(edge[next].to, edge[k].to) == 0)
        next++;
    return next;
}

static void join_patches(parts *s, const open_edge *edge, size_t count)
{
    for (size_t k = 0, next; k < count; k = next) {
        next = end_of_edge(edge, count, k);
        if (next - k == 2 && edge[k].patch != edge[k + 1].patch)
            orientation_join(&s->joined, edge[k].patch, edge[k + 1].patch,
                             edge[k].forwards == edge[k + 1].forwards);
    }
    for (uint32_t p = 0; p < s->p->count; p++) {
        s->root[p] = orientation_find(&s->joined, p, &s->turned[p]);
        s->is_closed[p] = true;
    }
    for (size_t k = 0, next; k < count; k = next) {
        next = end_of_edge(edge, count, k);
        for (size_t i = k; (next - k) % 2 == 1 && i < next; i++) s->is_closed[s->root[edge[i].patch]] = false;
    }
    for (uint32_t p = 0; p < s->p->count; p++)
        if (s->p->one_sided[p] || s->joined.conflict[s->root[p]]) s->is_closed[s->root[p]] = false;
}

static size_t triangles_of(const mesh_patches *p, size_t patch)
{
    return p->first[patch + 1] - p->first[patch];
}

/* Turns a whole part if more of its triangles would be reversed than not. */
static bool keep_majority(parts *s, error *e)
{
    size_t *against = mem_array(s->p->count, sizeof *against, what, e),
           *all = mem_array(s->p->count, sizeof *all, what, e);
    const bool ok = against && all;
    for (uint32_t p = 0; ok && p < s->p->count; p++) {
        const size_t count = triangles_of(s->p, p), reversed = s->p->reversed[p];
        against[s->root[p]] += s->turned[p] ? count - reversed : reversed;
        all[s->root[p]] += count;
    }
    for (uint32_t p = 0; ok && p < s->p->count; p++)
        s->turned[p] ^= 2 * against[s->root[p]] > all[s->root[p]];
    free(against);
    free(all);
    return ok;
}

/* ---- the outside of closed parts */

static void measure_parts(parts *s)
{
    for (uint32_t p = 0; p < s->p->count; p++) s->box[p] = bbox_empty();
    const vec3 origin = s->p->m.vertex[0]; /* volumes of closed parts do not depend on it */
    for (uint32_t p = 0; p < s->p->count; p++)
        for (size_t n = s->p->first[p]; n < s->p->first[p + 1]; n++) {
            vec3 c[3];
            mesh_get_corners(&s->p->m, n, c);
            const double volume =
                vec3_dot(vec3_sub(c[0], origin), vec3_cross(vec3_sub(c[1], origin), vec3_sub(c[2], origin)));
            s->volume[s->root[p]] += s->turned[p] ? -volume : volume;
            for (int k = 0; k < 3; k++) s->box[s->root[p]] = bbox_include(s->box[s->root[p]], c[k]);
        }
}

/* Whether the ray from x crosses the triangle. Moeller and Trumbore 1997. */
static bool crosses(const vec3 c[3], vec3 x, vec3 ray)
{
    const vec3 ab = vec3_sub(c[1], c[0]), ac = vec3_sub(c[2], c[0]), across = vec3_cross(ray, ac),
               to = vec3_sub(x, c[0]);
    const double determinant = vec3_dot(ab, across);
    if (determinant == 0) return false;
    const double u = vec3_dot(to, across) / determinant;
    const vec3 q = vec3_cross(to, ab);
    const double v = vec3_dot(ray, q) / determinant;
    return u >= 0 && v >= 0 && u + v <= 1 && vec3_dot(ac, q) / determinant > 0;
}

static bool is_in_box(const bbox *inner, const bbox *outer)
{
    return bbox_contains(*outer, inner->min) && bbox_contains(*outer, inner->max);
}

/* Whether a closed part lies inside another one; x: a place of it. */
static bool is_inside(const parts *s, vec3 x, uint32_t outer)
{
    int votes = 0;
    for (int r = 0; r < RAYS; r++) {
        bool odd = false;
        for (uint32_t p = 0; p < s->p->count; p++)
            for (size_t n = s->p->first[p]; s->root[p] == outer && n < s->p->first[p + 1]; n++) {
                vec3 c[3];
                mesh_get_corners(&s->p->m, n, c);
                odd ^= crosses(c, x, RAY[r]);
            }
        votes += odd;
    }
    return 2 * votes > RAYS;
}

/* The outermost closed part around a part; the part itself if there is none. */
static uint32_t outermost(const parts *s, uint32_t part)
{
    vec3 c[3];
    uint32_t found = part;
    mesh_get_corners(&s->p->m, s->p->first[part], c);
    const vec3 x = vec3_scale(vec3_add(c[0], vec3_add(c[1], c[2])), 1.0 / 3);
    for (uint32_t k = 0; k < s->p->count; k++)
        if (k != part && s->root[k] == k && s->is_closed[k] && is_in_box(&s->box[found], &s->box[k]) &&
            is_inside(s, x, k))
            found = k;
    return found;
}

/* Turns closed parts, with the parts inside them, so that the normals of the outermost ones point
 * outwards. */
static bool turn_outside(parts *s, error *e)
{
    bool *inwards = mem_array(s->p->count, sizeof *inwards, what, e);
    if (!inwards) return false;
    measure_parts(s);
    for (uint32_t p = 0; p < s->p->count; p++)
        if (s->root[p] == p && s->is_closed[p]) inwards[p] = s->volume[outermost(s, p)] < 0;
    for (uint32_t p = 0; p < s->p->count; p++) s->turned[p] ^= inwards[s->root[p]];
    free(inwards);
    return true;
}

static void turn_patch(mesh_patches *p, size_t patch)
{
    for (size_t n = p->first[patch]; n < p->first[patch + 1]; n++) {
        uint32_t *t = p->m.triangle[n], swap = t[1];
        t[1] = t[2];
        t[2] = swap;
    }
    p->reversed[patch] = triangles_of(p, patch) - p->reversed[patch];
}

bool mesh_orientation_fix(mesh_patches *p, error *e)
{
    parts s;
    size_t count = 0;
    open_edge *edge = list_open_edges(p, &count, e);
    bool ok = allocate_parts(p, &s, e) && edge;
    if (ok) join_patches(&s, edge, count);
    ok = ok && keep_majority(&s, e) && turn_outside(&s, e);
    p->turned = 0;
    for (size_t k = 0; ok && k < p->count; k++) {
        if (s.turned[k] && !p->one_sided[k]) turn_patch(p, k);
        p->turned += p->one_sided[k] ? 0 : p->reversed[k];
    }
    free_parts(&s);
    free(edge);
    return ok;
}
