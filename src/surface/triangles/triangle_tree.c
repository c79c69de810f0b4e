// SPDX-License-Identifier: Apache-2.0
#include "surface/triangles/triangle_tree.h"

#include <float.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/mesh/rounding.h"
#include "geometry/space/box_tree.h"
#include "geometry/space/triangle.h"

/* Mean number of boxes of triangles that contain a point of the surface, above which triangles are cut into pieces. Well-shaped
 * triangles: below 5. Smaller: more memory, and other triangles at equal distances. */
static const double MAX_OVERLAP = 32;
/* Maximum number of pieces of a triangle. Larger: fewer tests for each search, more memory. */
enum { MAX_PIECES = 16 };

/* The trees of a mesh. */
typedef struct lazy_tree {
    box_tree tree; /* of the triangles */
    box_tree
        pieces; /* of pieces of triangles, if their boxes overlap too much; `order` has their triangles */
    atomic_bool made;
    pthread_mutex_t making;
} lazy_tree;

struct triangle_tree {
    const mesh *mesh;
    bbox box; /* of all triangles */
    lazy_tree *lazy;
};

static inline triangle triangle_of(const mesh *m, size_t k)
{
    return triangle_of_corners(m->vertex, m->triangle[k]);
}

static bbox box_of_triangle(const void *context, uint32_t k)
{
    const triangle t = triangle_of(context, k);
    return triangle_box(&t);
}

/* Half of the area of the box of a triangle, and the triangle's area. */
static void measure_box(const triangle *t, double *half, double *area)
{
    const vec3 size = bbox_size(triangle_box(t));
    *half = size.x * size.y + size.y * size.z + size.z * size.x;
    *area = 0.5 * vec3_norm(vec3_across(t->a, t->b, t->c));
}

/* Number of pieces of a triangle: as many as its box is longer than a square of the triangle's area. */
static size_t pieces_of(const triangle *t)
{
    double half, area;
    measure_box(t, &half, &area);
    return (size_t)fmax(1, fmin(0.5 * sqrt(half / fmax(area, DBL_MIN)), MAX_PIECES));
}

/* The box of the part of a triangle with low <= coordinate <= high on an axis, larger by rounding errors. */
static bbox box_of_slab(const triangle *t, int axis, double low, double high)
{
    const vec3 corner[3] = {t->a, t->b, t->c};
    bbox box = bbox_empty();
    for (int k = 0; k < 3; k++) {
        const vec3 from = corner[k], side = vec3_sub(corner[(k + 1) % 3], from);
        const double at = vec3_get(from, axis), length = vec3_get(side, axis);
        if (at >= low && at <= high) box = bbox_include(box, from);
        for (int end = 0; end < 2; end++) {
            const double share = ((end ? high : low) - at) / length;
            if (share >= 0 && share <= 1) box = bbox_include(box, vec3_axpy(share, side, from));
        }
    }
    const double largest = fmax(rounding_largest_coordinate(box.min), rounding_largest_coordinate(box.max));
    return bbox_common(bbox_grow(box, 4 * DBL_EPSILON * largest), triangle_box(t));
}

typedef struct piece_list {
    bbox *box;          /* per piece */
    uint32_t *triangle; /* per piece */
    vec3 *centre;       /* per piece */
    size_t count;
} piece_list;

static void cut(const triangle *t, uint32_t n, piece_list *list)
{
    const bbox box = triangle_box(t);
    const vec3 size = bbox_size(box);
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    const double low = vec3_get(box.min, axis), high = vec3_get(box.max, axis);
    const size_t pieces = pieces_of(t);
    for (size_t k = 0; k < pieces; k++) {
        const double from = low + (high - low) * ((double)k / (double)pieces),
                     to = low + (high - low) * ((double)(k + 1) / (double)pieces);
        const bbox own = pieces > 1 ? box_of_slab(t, axis, from, to) : box;
        list->centre[list->count] = vec3_scale(vec3_add(own.min, own.max), 0.5);
        list->triangle[list->count] = n;
        list->box[list->count++] = own;
    }
}

static bbox box_of_piece(const void *context, uint32_t k)
{
    const piece_list *list = context;
    return list->box[k];
}

/* Builds the tree of pieces if the boxes of the triangles overlap more than MAX_OVERLAP: nearly every search would test nearly
 * every sliver that is not parallel to an axis. */
static bool make_pieces(const mesh *m, const threads *pool, const char *what, box_tree *out, error *e)
{
    double halves = 0, areas = 0;
    size_t count = 0;
    for (size_t k = 0; k < m->triangle_count; k++) {
        const triangle t = triangle_of(m, k);
        double half, area;
        measure_box(&t, &half, &area);
        halves += half;
        areas += area;
        count += pieces_of(&t);
    }
    if (!(halves > MAX_OVERLAP * areas) || count >= UINT32_MAX) return true;
    piece_list list = {mem_array(count, sizeof *list.box, what, e),
                       mem_array(count, sizeof *list.triangle, what, e),
                       mem_array(count, sizeof *list.centre, what, e), 0};
    bool ok = list.box && list.triangle && list.centre;
    for (uint32_t k = 0; ok && k < m->triangle_count; k++) {
        const triangle t = triangle_of(m, k);
        cut(&t, k, &list);
    }
    ok = ok && box_tree_make(count, list.centre, box_of_piece, &list, pool, what, out, e);
    for (size_t k = 0; ok && k < count; k++) out->order[k] = list.triangle[out->order[k]];
    free(list.box);
    free(list.triangle);
    free(list.centre);
    return ok;
}

static bool make(const mesh *m, const threads *pool, lazy_tree *out, error *e)
{
    static const char what[] = "the tree of a mesh";
    vec3 *centroid = mem_array(m->triangle_count, sizeof *centroid, what, e);
    for (size_t k = 0; centroid && k < m->triangle_count; k++) {
        const triangle t = triangle_of(m, k);
        centroid[k] = vec3_scale(vec3_add(t.a, vec3_add(t.b, t.c)), 1.0 / 3);
    }
    const bool ok =
        centroid && box_tree_make(m->triangle_count, centroid, box_of_triangle, m, pool, what, &out->tree, e);
    free(centroid);
    return ok && make_pieces(m, pool, what, &out->pieces, e);
}

triangle_tree *triangle_tree_new_lazy(const mesh *m)
{
    triangle_tree *n = mem_alloc(sizeof *n);
    *n = (triangle_tree){m, mesh_box(m, NULL), mem_alloc(sizeof *n->lazy)};
    pthread_mutex_init(&n->lazy->making, NULL);
    return n;
}

triangle_tree *triangle_tree_new(const mesh *m, const threads *pool, error *e)
{
    triangle_tree *n = triangle_tree_new_lazy(m);
    if (make(m, pool, n->lazy, e)) {
        n->lazy->made = true;
        return n;
    }
    triangle_tree_free(n);
    return NULL;
}

void triangle_tree_free(triangle_tree *n)
{
    if (!n) return;
    box_tree_free(&n->lazy->tree);
    box_tree_free(&n->lazy->pieces);
    pthread_mutex_destroy(&n->lazy->making);
    free(n->lazy);
    free(n);
}

/* The trees, built at the first call. A search returns no error: if memory is out, the process is aborted, as
 * by mem_alloc. Lazy trees are small (UNGROUPED in mesh_faces.c): 2 MB at most, and 1.6 MB more during
 * construction; with pieces of slivers up to 16 times as much. */
static const lazy_tree *trees_of(const triangle_tree *n)
{
    lazy_tree *l = n->lazy;
    if (atomic_load_explicit(&l->made, memory_order_acquire)) return l;
    pthread_mutex_lock(&l->making);
    if (!atomic_load_explicit(&l->made, memory_order_relaxed)) {
        if (!make(n->mesh, NULL, l, NULL)) abort();
        atomic_store_explicit(&l->made, true, memory_order_release);
    }
    pthread_mutex_unlock(&l->making);
    return l;
}

/* The tree for the search of near triangles, in which a triangle may occur several times. */
static const box_tree *near_tree_of(const triangle_tree *n)
{
    const lazy_tree *l = trees_of(n);
    return l->pieces.count > 0 ? &l->pieces : &l->tree;
}

static inline double least_of(double a, double b, double c)
{
    const double d = a < b ? a : b;
    return d < c ? d : c;
}

static inline double most_of(double a, double b, double c)
{
    const double d = a > b ? a : b;
    return d > c ? d : c;
}

/* Whether the bounding box of a triangle is farther than the squared distance, with a margin for rounding.
 * Rejects most triangles of a leaf. */
static inline bool is_beyond(const triangle *t, vec3 p, double distance2)
{
    const double margin = 1e-12;
    const bbox box = {
        {least_of(t->a.x, t->b.x, t->c.x), least_of(t->a.y, t->b.y, t->c.y),
         least_of(t->a.z, t->b.z, t->c.z)},
        {most_of(t->a.x, t->b.x, t->c.x), most_of(t->a.y, t->b.y, t->c.y), most_of(t->a.z, t->b.z, t->c.z)}};
    return box_tree_distance2(&box, p) > (1 + margin) * distance2;
}

/* The closest accepted triangle with a squared distance below *nearest, which receives its squared distance.
 * The number of triangles: there is none. */
static inline size_t search(const triangle_tree *n, vec3 p, double *nearest, triangle_tree_accept *accept,
                            const void *context)
{
    const box_tree *tree = near_tree_of(n);
    box_tree_walk w;
    size_t found = n->mesh->triangle_count;
    double best = *nearest;
    box_tree_begin_near(tree, &w, p);
    while (box_tree_next_near(tree, &w, best))
        for (size_t k = w.first; k < w.end; k++) {
            const triangle t = triangle_of(n->mesh, tree->order[k]);
            if (is_beyond(&t, p, best)) continue;
            const double distance2 = triangle_distance2(&t, p);
            if (!(distance2 < best)) continue;
            if (accept && !accept(context, tree->order[k], &t)) continue;
            best = distance2;
            found = tree->order[k];
        }
    *nearest = best;
    return found;
}

bool triangle_tree_find_nearer(const triangle_tree *n, vec3 p, double *distance2, size_t *nearest)
{
    const size_t found = search(n, p, distance2, NULL, NULL);
    if (found == n->mesh->triangle_count) return false;
    *nearest = found;
    return true;
}

static size_t weights_of(const triangle_tree *n, size_t found, vec3 p, double weight[3])
{
    const triangle t = triangle_of(n->mesh, found);
    triangle_weights(&t, p, weight);
    return found;
}

size_t triangle_tree_find(const triangle_tree *n, vec3 p, double weight[3])
{
    double distance2 = INFINITY;
    const size_t found = search(n, p, &distance2, NULL, NULL);
    return weights_of(n, found, p, weight);
}

/* An upper bound of the squared distance to triangle `start`, with a margin for rounding: a search with this
 * bound finds the same triangle as one without. */
static double bound_by(const triangle_tree *n, vec3 p, size_t start)
{
    const double margin = 1e-9;
    const triangle t = triangle_of(n->mesh, start);
    return (1 + margin) * triangle_distance2(&t, p) + DBL_MIN;
}

size_t triangle_tree_find_from(const triangle_tree *n, vec3 p, size_t start, double weight[3])
{
    double distance2 = bound_by(n, p, start);
    const size_t found = search(n, p, &distance2, NULL, NULL);
    if (found == n->mesh->triangle_count) return triangle_tree_find(n, p, weight);
    return weights_of(n, found, p, weight);
}

/* Where the line through p in the direction d crosses a triangle; NAN: it does not. *det: -d . normal.
 * Source: Moeller and Trumbore 1997, "Fast, Minimum Storage Ray/Triangle Intersection". */
static inline double crossing_at(const triangle *t, vec3 p, vec3 d, double *det)
{
    const vec3 ab = vec3_sub(t->b, t->a), ac = vec3_sub(t->c, t->a);
    const vec3 q = vec3_cross(d, ac), from = vec3_sub(p, t->a);
    *det = vec3_dot(ab, q);
    const double u = vec3_dot(from, q) / *det;
    if (!(u >= 0 && u <= 1)) return NAN; /* true also for a parallel triangle */
    const vec3 r = vec3_cross(from, ab);
    const double v = vec3_dot(d, r) / *det;
    return v >= 0 && u + v <= 1 ? vec3_dot(ac, r) / *det : NAN;
}

static inline void cross_triangle(const triangle *t, vec3 p, vec3 d, line_crossings *out)
{
    double det;
    const double at = crossing_at(t, p, d, &det);
    if (at < 0) out->behind = fmin(out->behind, -at);
    if (!(at >= 0)) return;
    out->ahead = fmin(out->ahead, at);
    out->winding += det < 0 ? 1 : -1;
}

/* Adds the crossings with the triangles of a tree. */
static void cross(const triangle_tree *n, vec3 p, vec3 d, uint32_t skip, line_crossings *out)
{
    const box_tree *tree = &trees_of(n)->tree;
    box_tree_walk w;
    box_tree_begin(tree, &w);
    while (box_tree_next_crossed(tree, &w, p, d))
        for (size_t k = w.first; k < w.end; k++) {
            const triangle t = triangle_of(n->mesh, tree->order[k]);
            if (tree->order[k] != skip) cross_triangle(&t, p, d, out);
        }
}

line_crossings triangle_tree_cross(const triangle_tree *n, vec3 p, vec3 d, uint32_t skip)
{
    line_crossings out = {INFINITY, INFINITY, 0};
    cross(n, p, d, skip, &out);
    return out;
}

static void visit_tree(const triangle_tree *n, size_t number, vec3 p, double distance2,
                       triangle_tree_visitor *visit, void *context)
{
    const box_tree *tree = near_tree_of(n);
    const double beyond = nextafter(distance2, INFINITY);
    box_tree_walk w;
    box_tree_begin_near(tree, &w, p);
    while (box_tree_next_near(tree, &w, beyond))
        for (size_t k = w.first; k < w.end; k++) {
            const triangle t = triangle_of(n->mesh, tree->order[k]);
            if (triangle_distance2(&t, p) <= distance2) visit(context, number, tree->order[k], &t);
        }
}

void triangle_tree_visit_near(const triangle_tree *n, vec3 p, double distance2, triangle_tree_visitor *visit,
                              void *context)
{
    visit_tree(n, 0, p, distance2, visit, context);
}

bbox triangle_tree_box(const triangle_tree *n)
{
    return n->box;
}

size_t triangle_tree_bytes(const triangle_tree *n)
{
    const size_t pieces = n->lazy->pieces.count;
    return box_tree_bytes(n->mesh->triangle_count) + (pieces > 0 ? box_tree_bytes(pieces) : 0);
}

/* ---- forests */

struct triangle_forest {
    const triangle_tree **tree;
    bbox box;       /* of all trees */
    box_tree boxes; /* of the trees */
};

static bbox box_of_tree(const void *context, uint32_t k)
{
    const triangle_tree *const *tree = context;
    return tree[k]->box;
}

triangle_forest *triangle_forest_new(const triangle_tree *const *tree, size_t count, error *e)
{
    static const char what[] = "the tree of meshes";
    triangle_forest *n = mem_alloc(sizeof *n);
    vec3 *middle = mem_array(count, sizeof *middle, what, e);
    n->tree = mem_array(count, sizeof *n->tree, what, e);
    bool ok = middle && n->tree;
    n->box = bbox_empty();
    for (size_t k = 0; ok && k < count; k++) {
        n->box = bbox_unite(n->box, tree[k]->box);
        n->tree[k] = tree[k];
        middle[k] = vec3_scale(vec3_add(tree[k]->box.min, tree[k]->box.max), 0.5);
    }
    ok = ok && box_tree_make(count, middle, box_of_tree, n->tree, NULL, what, &n->boxes, e);
    free(middle);
    if (ok) return n;
    triangle_forest_free(n);
    return NULL;
}

void triangle_forest_free(triangle_forest *n)
{
    if (!n) return;
    free(n->tree);
    box_tree_free(&n->boxes);
    free(n);
}

/* The closest triangle found so far. */
typedef struct forest_result {
    double distance2;
    size_t tree, triangle;
} forest_result;

/* Searches one tree. At equal distances the earlier tree wins. True: *yet is replaced. */
static bool search_tree(const triangle_forest *n, size_t tree, vec3 p, forest_result *yet)
{
    if (tree == yet->tree && yet->distance2 < INFINITY) return false;
    double distance2 = tree < yet->tree ? nextafter(yet->distance2, INFINITY) : yet->distance2;
    if (!(box_tree_distance2(&n->tree[tree]->box, p) < distance2) ||
        !triangle_tree_find_nearer(n->tree[tree], p, &distance2, &yet->triangle))
        return false;
    *yet = (forest_result){distance2, tree, yet->triangle};
    return true;
}

static forest_result search_forest(const triangle_forest *n, vec3 p, forest_result yet)
{
    box_tree_walk w;
    double bound2 = nextafter(yet.distance2, INFINITY); /* trees at the same distance are searched, too */
    box_tree_begin_near(&n->boxes, &w, p);
    while (box_tree_next_near(&n->boxes, &w, bound2))
        for (size_t k = w.first; k < w.end; k++)
            if (search_tree(n, n->boxes.order[k], p, &yet)) bound2 = nextafter(yet.distance2, INFINITY);
    return yet;
}

size_t triangle_forest_find(const triangle_forest *n, vec3 p, size_t *nearest)
{
    const forest_result found =
        search_forest(n, p, (forest_result){INFINITY, 0, 0}); /* the result if p is NaN */
    *nearest = found.triangle;
    return found.tree;
}

bool triangle_forest_find_accepted(const triangle_forest *n, vec3 p, double within,
                                   triangle_tree_accept *accept, const void *context, vec3 *place)
{
    double best = within * within;
    bool is_found = false;
    triangle found;
    box_tree_walk w;
    box_tree_begin_near(&n->boxes, &w, p);
    while (box_tree_next_near(&n->boxes, &w, best))
        for (size_t k = w.first; k < w.end; k++) {
            const triangle_tree *tree = n->tree[n->boxes.order[k]];
            if (!(box_tree_distance2(&tree->box, p) < best)) continue;
            const size_t at = search(tree, p, &best, accept, context);
            if (at == tree->mesh->triangle_count) continue;
            found = triangle_of(tree->mesh, at);
            is_found = true;
        }
    if (is_found) *place = triangle_nearest(&found, p);
    return is_found;
}

line_crossings triangle_forest_cross(const triangle_forest *n, vec3 p, vec3 d)
{
    line_crossings out = {INFINITY, INFINITY, 0};
    box_tree_walk w;
    box_tree_begin(&n->boxes, &w);
    while (box_tree_next_crossed(&n->boxes, &w, p, d))
        for (size_t k = w.first; k < w.end; k++)
            cross(n->tree[n->boxes.order[k]], p, d, TRIANGLE_TREE_NONE, &out);
    return out;
}

/* Replaces *yet by the first crossing with a tree if that is nearer. */
static void cross_first(const triangle_forest *n, size_t number, vec3 p, vec3 d, const ray_crossing *skip,
                        ray_crossing *yet)
{
    const triangle_tree *own = n->tree[number];
    const box_tree *tree = near_tree_of(own);
    const box_tree_ray ray = box_tree_ray_make(tree, p, d);
    box_tree_walk w;
    box_tree_begin_ray(tree, &w, &ray, yet->distance);
    while (box_tree_next_on_ray(tree, &w, &ray, yet->distance))
        for (size_t k = w.first; k < w.end; k++) {
            const triangle t = triangle_of(own->mesh, tree->order[k]);
            double det;
            const double at = crossing_at(&t, p, d, &det);
            if (at >= 0 && at < yet->distance && (tree->order[k] != skip->triangle || number != skip->tree))
                *yet = (ray_crossing){at, number, tree->order[k]};
        }
}

ray_crossing triangle_forest_first_crossing(const triangle_forest *n, vec3 p, vec3 d, double within,
                                            const ray_crossing *skip)
{
    const box_tree_ray ray = box_tree_ray_make(&n->boxes, p, d);
    ray_crossing found = {within, n->boxes.count, 0};
    box_tree_walk w;
    box_tree_begin_ray(&n->boxes, &w, &ray, within);
    while (box_tree_next_on_ray(&n->boxes, &w, &ray, found.distance))
        for (size_t k = w.first; k < w.end; k++) cross_first(n, n->boxes.order[k], p, d, skip, &found);
    if (found.tree == n->boxes.count) found.distance = INFINITY;
    return found;
}

void triangle_forest_improve(const triangle_forest *n, vec3 p, size_t *tree, size_t *nearest)
{
    const triangle t = triangle_of(n->tree[*tree]->mesh, *nearest);
    const forest_result found =
        search_forest(n, p, (forest_result){triangle_distance2(&t, p), *tree, *nearest});
    *tree = found.tree;
    *nearest = found.triangle;
}

void triangle_forest_visit_near(const triangle_forest *n, vec3 p, double distance2,
                                triangle_tree_visitor *visit, void *context)
{
    box_tree_walk w;
    box_tree_begin_near(&n->boxes, &w, p);
    while (box_tree_next_near(&n->boxes, &w, nextafter(distance2, INFINITY)))
        for (size_t k = w.first; k < w.end; k++) {
            const size_t tree = n->boxes.order[k];
            if (box_tree_distance2(&n->tree[tree]->box, p) <= distance2)
                visit_tree(n->tree[tree], tree, p, distance2, visit, context);
        }
}

bbox triangle_forest_box(const triangle_forest *n)
{
    return n->box;
}

size_t triangle_forest_bytes(const triangle_forest *n)
{
    return n->boxes.count * sizeof *n->tree + box_tree_bytes(n->boxes.count);
}
