#include "mesh/nearest_triangle.h"

#include <float.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>

#include "base/memory.h"
#include "geometry/triangle.h"
#include "geometry/point_tree.h"

/* LEAF: maximum number of triangles, or trees, in a leaf; a box test costs about as much as one triangle. DEEPEST: capacity of the search stack. */
enum { LEAF = 4, DEEPEST = 64 };

/* The tree of a mesh. */
typedef struct halves {
    uint32_t *order; /* triangles; those of a node are consecutive */
    bbox *box;       /* of node k, whose children are 2 k + 1 and 2 k + 2 */
    atomic_bool made;
    pthread_mutex_t making;
} halves;

struct nearest_triangle {
    const mesh *mesh;
    bbox box; /* of all triangles */
    halves *halves;
};

/* Number of nodes of a tree over `count` triangles. */
static size_t places_for(size_t count)
{
    size_t nodes = 1;
    for (; count > LEAF; count -= count / 2) nodes = 2 * nodes + 1;
    return nodes;
}

static inline triangle triangle_of(const mesh *m, size_t k)
{
    const uint32_t *corner = m->triangle[k];
    return (triangle){m->vertex[corner[0]], m->vertex[corner[1]], m->vertex[corner[2]]};
}

/* Builds a node by halving the triangles across the longest side of the box of their centroids. */
static bbox build(const mesh *m, halves *h, size_t node, const vec3 *middle, size_t first, size_t count)
{
    bbox box = bbox_empty();
    if (count <= LEAF) {
        for (size_t k = first; k < first + count; k++) {
            const triangle t = triangle_of(m, h->order[k]);
            box = bbox_unite(box, triangle_box(&t));
        }
    } else {
        const size_t half = count / 2;
        point_tree_halve(middle, h->order + first, count);
        box = bbox_unite(build(m, h, 2 * node + 1, middle, first, half),
                         build(m, h, 2 * node + 2, middle, first + half, count - half));
    }
    return h->box[node] = box;
}

static bool make(const mesh *m, halves *h, error *e)
{
    const char *what = "the tree of a mesh";
    vec3 *middle = mem_array(m->triangle_count, sizeof *middle, what, e);
    h->order = mem_array(m->triangle_count, sizeof *h->order, what, e);
    h->box = mem_array(places_for(m->triangle_count), sizeof *h->box, what, e);
    const bool ok = middle && h->order && h->box;
    for (uint32_t k = 0; ok && k < m->triangle_count; k++) {
        const triangle t = triangle_of(m, k);
        middle[k] = vec3_scale(vec3_add(t.a, vec3_add(t.b, t.c)), 1.0 / 3);
        h->order[k] = k;
    }
    if (ok) build(m, h, 0, middle, 0, m->triangle_count);
    free(middle);
    return ok;
}

nearest_triangle *nearest_triangle_new_lazy(const mesh *m)
{
    nearest_triangle *n = mem_alloc(sizeof *n);
    *n = (nearest_triangle){m, mesh_box(m, NULL), mem_alloc(sizeof *n->halves)};
    pthread_mutex_init(&n->halves->making, NULL);
    return n;
}

nearest_triangle *nearest_triangle_new(const mesh *m, error *e)
{
    nearest_triangle *n = nearest_triangle_new_lazy(m);
    if (make(m, n->halves, e)) {
        n->halves->made = true;
        return n;
    }
    nearest_triangle_free(n);
    return NULL;
}

void nearest_triangle_free(nearest_triangle *n)
{
    if (!n) return;
    free(n->halves->order);
    free(n->halves->box);
    pthread_mutex_destroy(&n->halves->making);
    free(n->halves);
    free(n);
}

/* The tree, built at the first call. A search returns no error: if memory is out, the process is aborted, as by mem_alloc. Lazy trees are small
 * (UNGROUPED in mesh_faces.c): 8 MB at most. */
static const halves *halves_of(const nearest_triangle *n)
{
    halves *h = n->halves;
    if (atomic_load_explicit(&h->made, memory_order_acquire)) return h;
    pthread_mutex_lock(&h->making);
    if (!atomic_load_explicit(&h->made, memory_order_relaxed)) {
        if (!make(n->mesh, h, NULL)) abort();
        atomic_store_explicit(&h->made, true, memory_order_release);
    }
    pthread_mutex_unlock(&h->making);
    return h;
}

/* Distance of x from the interval. (Without fmax, which is a function call.) */
static inline double outside(double low, double high, double x)
{
    const double below = low - x, above = x - high, most = below > above ? below : above;
    return most > 0 ? most : 0;
}

static inline double box_distance2(const bbox *b, vec3 p)
{
    const vec3 d = {outside(b->min.x, b->max.x, p.x), outside(b->min.y, b->max.y, p.y),
                    outside(b->min.z, b->max.z, p.z)};
    return vec3_norm2(d);
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

/* Whether the bounding box of a triangle is farther than the squared distance, with a margin for rounding. Rejects most triangles of a leaf. */
static inline bool is_beyond(const triangle *t, vec3 p, double distance2)
{
    const double hair = 1e-12;
    const bbox box = {
        {least_of(t->a.x, t->b.x, t->c.x), least_of(t->a.y, t->b.y, t->c.y),
         least_of(t->a.z, t->b.z, t->c.z)},
        {most_of(t->a.x, t->b.x, t->c.x), most_of(t->a.y, t->b.y, t->c.y), most_of(t->a.z, t->b.z, t->c.z)}};
    return box_distance2(&box, p) > (1 + hair) * distance2;
}

/* A subtree that is still to be searched. */
typedef struct visit {
    size_t node, first, count;
    double distance2;
} visit;

/* The closest accepted triangle with a squared distance below *nearest, which receives its squared distance. The number of triangles: there is
 * none. */
static inline size_t search(const nearest_triangle *n, vec3 p, double *nearest,
                            nearest_triangle_accept *accept, const void *context)
{
    const halves *h = halves_of(n);
    visit stack[DEEPEST];
    size_t found = n->mesh->triangle_count;
    double best = *nearest;
    stack[0] = (visit){0, 0, found, box_distance2(&n->box, p)};
    for (int depth = 1; depth > 0;) {
        const visit v = stack[--depth];
        if (!(v.distance2 < best)) continue;
        if (v.count <= LEAF) {
            for (size_t k = v.first; k < v.first + v.count; k++) {
                const triangle t = triangle_of(n->mesh, h->order[k]);
                if (is_beyond(&t, p, best)) continue;
                const double distance2 = triangle_distance2(&t, p);
                if (!(distance2 < best)) continue;
                if (accept && !accept(context, h->order[k], &t)) continue;
                best = distance2;
                found = h->order[k];
            }
            continue;
        }
        size_t half = v.count / 2, left = 2 * v.node + 1, right = left + 1;
        const visit a = {left, v.first, half, box_distance2(&h->box[left], p)},
                    b = {right, v.first + half, v.count - half, box_distance2(&h->box[right], p)};
        bool swap = a.distance2 < b.distance2; /* the nearer one is searched first */
        stack[depth++] = swap ? b : a;
        stack[depth++] = swap ? a : b;
    }
    *nearest = best;
    return found;
}

bool nearest_triangle_find_nearer(const nearest_triangle *n, vec3 p, double *distance2, size_t *nearest)
{
    const size_t found = search(n, p, distance2, NULL, NULL);
    if (found == n->mesh->triangle_count) return false;
    *nearest = found;
    return true;
}

static size_t weights_of(const nearest_triangle *n, size_t found, vec3 p, double weight[3])
{
    const triangle t = triangle_of(n->mesh, found);
    triangle_weights(&t, p, weight);
    return found;
}

size_t nearest_triangle_find(const nearest_triangle *n, vec3 p, double weight[3])
{
    double distance2 = INFINITY;
    const size_t found = search(n, p, &distance2, NULL, NULL);
    return weights_of(n, found, p, weight);
}

/* An upper bound of the squared distance to triangle `start`, with a margin for rounding: a search with this bound finds the same triangle as one
 * without. */
static double bound_by(const nearest_triangle *n, vec3 p, size_t start)
{
    const double hair = 1e-9;
    const triangle t = triangle_of(n->mesh, start);
    return (1 + hair) * triangle_distance2(&t, p) + DBL_MIN;
}

size_t nearest_triangle_find_from(const nearest_triangle *n, vec3 p, size_t start, double weight[3])
{
    double distance2 = bound_by(n, p, start);
    const size_t found = search(n, p, &distance2, NULL, NULL);
    if (found == n->mesh->triangle_count) return nearest_triangle_find(n, p, weight);
    return weights_of(n, found, p, weight);
}

static inline bool boxes_meet(const bbox *a, const bbox *b)
{
    return a->min.x <= b->max.x && b->min.x <= a->max.x && a->min.y <= b->max.y && b->min.y <= a->max.y &&
           a->min.z <= b->max.z && b->min.z <= a->max.z;
}

static inline bool is_beside(double a, double b, double c, double low, double high)
{
    return (a < low && b < low && c < low) || (a > high && b > high && c > high);
}

static inline bool triangle_meets(const triangle *t, const bbox *b)
{
    return !is_beside(t->a.x, t->b.x, t->c.x, b->min.x, b->max.x) &&
           !is_beside(t->a.y, t->b.y, t->c.y, b->min.y, b->max.y) &&
           !is_beside(t->a.z, t->b.z, t->c.z, b->min.z, b->max.z);
}

bool nearest_triangle_any_in_box(const nearest_triangle *n, bbox box, nearest_triangle_accept *accept,
                                 const void *context)
{
    const halves *h = halves_of(n);
    visit stack[DEEPEST];
    stack[0] = (visit){0, 0, n->mesh->triangle_count, 0};
    for (int depth = 1; depth > 0;) {
        const visit v = stack[--depth];
        if (!boxes_meet(&h->box[v.node], &box)) continue;
        if (v.count <= LEAF) {
            for (size_t k = v.first; k < v.first + v.count; k++) {
                const triangle t = triangle_of(n->mesh, h->order[k]);
                if (triangle_meets(&t, &box) && accept(context, h->order[k], &t)) return true;
            }
            continue;
        }
        const size_t half = v.count / 2;
        stack[depth++] = (visit){2 * v.node + 2, v.first + half, v.count - half, 0};
        stack[depth++] = (visit){2 * v.node + 1, v.first, half, 0};
    }
    return false;
}

bool nearest_triangle_find_accepted(const nearest_triangle *n, vec3 p, double within,
                                    nearest_triangle_accept *accept, const void *context, vec3 *place)
{
    double distance2 = within * within;
    const size_t found = search(n, p, &distance2, accept, context);
    if (found == n->mesh->triangle_count) return false;
    const triangle t = triangle_of(n->mesh, found);
    *place = triangle_nearest(&t, p);
    return true;
}

size_t nearest_triangle_bytes(const nearest_triangle *n)
{
    const size_t count = n->mesh->triangle_count;
    const halves *h = n->halves;
    return count * sizeof *h->order + places_for(count) * sizeof *h->box;
}

/* ---- forests */

struct triangle_forest {
    const nearest_triangle **tree;
    size_t count;
    uint32_t *order; /* trees; those of a node are consecutive */
    bbox *box;       /* of the nodes, numbered as in `halves` */
};

static bbox build_forest(triangle_forest *n, size_t node, const vec3 *middle, size_t first, size_t count)
{
    bbox box = bbox_empty();
    if (count <= LEAF) {
        for (size_t k = first; k < first + count; k++) box = bbox_unite(box, n->tree[n->order[k]]->box);
    } else {
        const size_t half = count / 2;
        point_tree_halve(middle, n->order + first, count);
        box = bbox_unite(build_forest(n, 2 * node + 1, middle, first, half),
                         build_forest(n, 2 * node + 2, middle, first + half, count - half));
    }
    return n->box[node] = box;
}

triangle_forest *triangle_forest_new(const nearest_triangle *const *tree, size_t count, error *e)
{
    const char *what = "the tree of meshes";
    triangle_forest *n = mem_alloc(sizeof *n);
    vec3 *middle = mem_array(count, sizeof *middle, what, e);
    n->count = count;
    n->tree = mem_array(count, sizeof *n->tree, what, e);
    n->order = mem_array(count, sizeof *n->order, what, e);
    n->box = mem_array(places_for(count), sizeof *n->box, what, e);
    const bool ok = middle && n->tree && n->order && n->box;
    for (uint32_t k = 0; ok && k < count; k++) {
        n->tree[k] = tree[k];
        n->order[k] = k;
        middle[k] = vec3_scale(vec3_add(tree[k]->box.min, tree[k]->box.max), 0.5);
    }
    if (ok) build_forest(n, 0, middle, 0, count);
    free(middle);
    if (ok) return n;
    triangle_forest_free(n);
    return NULL;
}

void triangle_forest_free(triangle_forest *n)
{
    if (!n) return;
    free(n->tree);
    free(n->order);
    free(n->box);
    free(n);
}

/* The closest triangle found so far. */
typedef struct forest_result {
    double distance2;
    size_t tree, triangle;
} forest_result;

/* Searches one tree. At equal distances the earlier tree wins. */
static void search_tree(const triangle_forest *n, size_t tree, vec3 p, forest_result *yet)
{
    if (tree == yet->tree && yet->distance2 < INFINITY) return;
    double distance2 = tree < yet->tree ? nextafter(yet->distance2, INFINITY) : yet->distance2;
    if (!(box_distance2(&n->tree[tree]->box, p) < distance2)) return;
    if (nearest_triangle_find_nearer(n->tree[tree], p, &distance2, &yet->triangle))
        *yet = (forest_result){distance2, tree, yet->triangle};
}

/* The children of a node, the nearer one first. */
static inline void forest_halves(const triangle_forest *n, const visit *v, vec3 p, visit out[2])
{
    const size_t half = v->count / 2, left = 2 * v->node + 1, right = left + 1;
    const visit a = {left, v->first, half, box_distance2(&n->box[left], p)},
                b = {right, v->first + half, v->count - half, box_distance2(&n->box[right], p)};
    const bool swap = a.distance2 < b.distance2;
    out[0] = swap ? a : b;
    out[1] = swap ? b : a;
}

static forest_result search_forest(const triangle_forest *n, vec3 p, forest_result yet)
{
    visit stack[DEEPEST];
    size_t depth = 0;
    stack[depth++] = (visit){0, 0, n->count, box_distance2(&n->box[0], p)};
    while (depth > 0) {
        const visit v = stack[--depth];
        if (!(v.distance2 <= yet.distance2)) continue;
        if (v.count <= LEAF) {
            for (size_t k = v.first; k < v.first + v.count; k++) search_tree(n, n->order[k], p, &yet);
            continue;
        }
        visit half[2];
        forest_halves(n, &v, p, half);
        stack[depth++] = half[1];
        stack[depth++] = half[0];
    }
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
                                   nearest_triangle_accept *accept, const void *context, vec3 *place)
{
    double best = within * within;
    bool is_found = false;
    triangle found;
    visit stack[DEEPEST];
    stack[0] = (visit){0, 0, n->count, box_distance2(&n->box[0], p)};
    for (int depth = 1; depth > 0;) {
        const visit v = stack[--depth];
        if (!(v.distance2 < best)) continue;
        if (v.count <= LEAF) {
            for (size_t k = v.first; k < v.first + v.count; k++) {
                const nearest_triangle *tree = n->tree[n->order[k]];
                if (!(box_distance2(&tree->box, p) < best)) continue;
                const size_t at = search(tree, p, &best, accept, context);
                if (at == tree->mesh->triangle_count) continue;
                found = triangle_of(tree->mesh, at);
                is_found = true;
            }
            continue;
        }
        visit half[2];
        forest_halves(n, &v, p, half);
        stack[depth++] = half[1];
        stack[depth++] = half[0];
    }
    if (is_found) *place = triangle_nearest(&found, p);
    return is_found;
}

void triangle_forest_improve(const triangle_forest *n, vec3 p, size_t *tree, size_t *nearest)
{
    const triangle t = triangle_of(n->tree[*tree]->mesh, *nearest);
    const forest_result found =
        search_forest(n, p, (forest_result){triangle_distance2(&t, p), *tree, *nearest});
    *tree = found.tree;
    *nearest = found.triangle;
}

size_t triangle_forest_bytes(const triangle_forest *n)
{
    return n->count * (sizeof *n->tree + sizeof *n->order) + places_for(n->count) * sizeof *n->box;
}
