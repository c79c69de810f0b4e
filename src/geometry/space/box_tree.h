// SPDX-License-Identifier: Apache-2.0
/* box_tree: a hierarchy of bounding boxes over triangles, segments, boxes or other hierarchies, which are its
 * items.
 *
 * A node is divided into two of equal numbers of items across the longest side of the box of their centres. A
 * search is a walk: it returns the leaves that may have items of interest, and the caller tests these items.
 * box_tree_next_near visits the nearer child of a node first; the other walks visit the first one first.
 * Boxes are stored as floats relative to the middle of the tree, rounded outwards: they contain their items, and
 * trees far from the origin of the coordinates are as exact as others.
 * Complexity for n items: construction O(n log n); memory 4 n + 24 m bytes, where n / 2 - 1 <= m <= n is the
 * number of nodes; a search O(log n + items found) if few boxes overlap, O(n) at worst.
 * Searches: any number of threads, while box_tree_extend does not run.
 */
#ifndef HEXAD_GEOMETRY_SPACE_BOX_TREE_H
#define HEXAD_GEOMETRY_SPACE_BOX_TREE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/bbox.h"

/* BOX_TREE_LEAF: maximum number of items of a leaf; the test of a box takes about as long as the test of one
 * triangle. BOX_TREE_DEEPEST: capacity of the stack of a walk, which suffices for 2^32 items. */
enum { BOX_TREE_LEAF = 4, BOX_TREE_DEEPEST = 64 };

/* The box of a node, relative to the middle of its tree. */
typedef struct box_tree_bounds {
    float min[3], max[3];
} box_tree_bounds;

typedef struct box_tree {
    size_t count;         /* of items */
    uint32_t *order;      /* the items; those of a node are consecutive */
    vec3 middle;          /* of all items */
    box_tree_bounds *box; /* of node k, which has the children 2 k + 1 and 2 k + 2; node 0 is the root */
} box_tree;

/* Returns the box of an item. */
typedef bbox box_tree_box(const void *context, uint32_t item);

/* Builds the tree of `count` < 2^32 items with the given centres. `what`: the object that messages name.
 * `pool` may be NULL; only its flag is used. Errors: limit_memory, cancelled; then *out is unchanged. */
bool box_tree_make(size_t count, const vec3 *centre, box_tree_box *box_of, const void *context,
                   const threads *pool, const char *what, box_tree *out, error *e);
void box_tree_free(box_tree *t); /* accepts a zeroed object */
size_t box_tree_bytes(size_t count);

/* Enlarges the boxes of all nodes that have the item order[at] to contain x. O(log n). */
void box_tree_extend(box_tree *t, size_t at, vec3 x);

/* A node that is still to be searched. */
typedef struct box_tree_node {
    size_t node, first, count;
    double distance2;
} box_tree_node;

/* A walk over leaves. The present leaf has the items order[first] .. order[end - 1]. */
typedef struct box_tree_walk {
    size_t first, end;
    vec3 place; /* of the search, relative to the middle of the tree; only of box_tree_begin_near */
    int depth;
    box_tree_node stack[BOX_TREE_DEEPEST];
} box_tree_walk;

/* Distance of x from the interval. (Without fmax, which is a function call.) */
static inline double box_tree_outside(double low, double high, double x)
{
    const double below = low - x, above = x - high, most = below > above ? below : above;
    return most > 0 ? most : 0;
}

/* Squared distance of p from a box. */
static inline double box_tree_distance2(const bbox *b, vec3 p)
{
    const vec3 d = {box_tree_outside(b->min.x, b->max.x, p.x), box_tree_outside(b->min.y, b->max.y, p.y),
                    box_tree_outside(b->min.z, b->max.z, p.z)};
    return vec3_norm2(d);
}

/* Squared distance of p from a node; p is relative to the middle of the tree. */
static inline double box_tree_node_distance2(const box_tree_bounds *b, vec3 p)
{
    const vec3 d = {box_tree_outside(b->min[0], b->max[0], p.x), box_tree_outside(b->min[1], b->max[1], p.y),
                    box_tree_outside(b->min[2], b->max[2], p.z)};
    return vec3_norm2(d);
}

/* Begins a walk to a place p, for box_tree_next_near. (The stack is not initialised: that would take longer
 * than most searches.) */
static inline void box_tree_begin_near(const box_tree *t, box_tree_walk *w, vec3 p)
{
    w->depth = 1;
    w->place = vec3_sub(p, t->middle);
    w->stack[0] = (box_tree_node){0, 0, t->count, box_tree_node_distance2(&t->box[0], w->place)};
}

/* Begins another walk. */
static inline void box_tree_begin(const box_tree *t, box_tree_walk *w)
{
    w->depth = 1;
    w->stack[0] = (box_tree_node){0, 0, t->count, 0};
}

static inline void box_tree_set_leaf(box_tree_walk *w, const box_tree_node *n)
{
    w->first = n->first;
    w->end = n->first + n->count;
}

/* The children of a node, without distances. */
static inline void box_tree_halves(const box_tree_node *n, box_tree_node *left, box_tree_node *right)
{
    const size_t half = n->count / 2;
    *left = (box_tree_node){2 * n->node + 1, n->first, half, 0};
    *right = (box_tree_node){2 * n->node + 2, n->first + half, n->count - half, 0};
}

/* Moves to the next leaf whose squared distance from the place of the walk is less than `bound2`, which may
 * decrease during the walk. False: there is none. */
static inline bool box_tree_next_near(const box_tree *t, box_tree_walk *w, double bound2)
{
    while (w->depth > 0) {
        const box_tree_node n = w->stack[--w->depth];
        if (!(n.distance2 < bound2)) continue;
        if (n.count <= BOX_TREE_LEAF) {
            box_tree_set_leaf(w, &n);
            return true;
        }
        box_tree_node left, right;
        box_tree_halves(&n, &left, &right);
        left.distance2 = box_tree_node_distance2(&t->box[left.node], w->place);
        right.distance2 = box_tree_node_distance2(&t->box[right.node], w->place);
        const bool left_first = left.distance2 < right.distance2;
        w->stack[w->depth++] = left_first ? right : left;
        w->stack[w->depth++] = left_first ? left : right;
    }
    return false;
}

static inline void box_tree_push_both(box_tree_walk *w, const box_tree_node *n)
{
    box_tree_halves(n, &w->stack[w->depth + 1], &w->stack[w->depth]);
    w->depth += 2;
}

/* The box of a node. */
static inline bbox box_tree_box_at(const box_tree *t, size_t node)
{
    const box_tree_bounds *b = &t->box[node];
    return (bbox){vec3_add(t->middle, vec3_make(b->min[0], b->min[1], b->min[2])),
                  vec3_add(t->middle, vec3_make(b->max[0], b->max[1], b->max[2]))};
}

/* Moves to the next leaf whose box has a common point with `where`. False: there is none. */
static inline bool box_tree_next_meeting(const box_tree *t, box_tree_walk *w, const bbox *where)
{
    while (w->depth > 0) {
        const box_tree_node n = w->stack[--w->depth];
        const bbox box = box_tree_box_at(t, n.node);
        if (!bbox_meet(&box, where)) continue;
        if (n.count <= BOX_TREE_LEAF) {
            box_tree_set_leaf(w, &n);
            return true;
        }
        box_tree_push_both(w, &n);
    }
    return false;
}

/* Whether the line through p in the direction d meets a box. */
static inline bool box_tree_is_crossed(const bbox *b, vec3 p, vec3 d)
{
    double low = -INFINITY, high = INFINITY;
    for (int axis = 0; axis < 3; axis++) {
        const double o = vec3_get(p, axis), way = vec3_get(d, axis), from = vec3_get(b->min, axis),
                     to = vec3_get(b->max, axis);
        if (way == 0) {
            if (o < from || o > to) return false;
            continue;
        }
        const double a = (from - o) / way, c = (to - o) / way, near = a < c ? a : c, far = a < c ? c : a;
        low = near > low ? near : low;
        high = far < high ? far : high;
    }
    return low <= high;
}

/* Moves to the next leaf whose box the line through p in the direction d meets. False: there is none. */
static inline bool box_tree_next_crossed(const box_tree *t, box_tree_walk *w, vec3 p, vec3 d)
{
    while (w->depth > 0) {
        const box_tree_node n = w->stack[--w->depth];
        const bbox box = box_tree_box_at(t, n.node);
        if (!box_tree_is_crossed(&box, p, d)) continue;
        if (n.count <= BOX_TREE_LEAF) {
            box_tree_set_leaf(w, &n);
            return true;
        }
        box_tree_push_both(w, &n);
    }
    return false;
}

/* A ray from p, relative to the middle of a tree; `inverse`: of the coordinates of its direction, a unit vector. */
typedef struct box_tree_ray {
    vec3 p, inverse;
} box_tree_ray;

static inline box_tree_ray box_tree_ray_make(const box_tree *t, vec3 p, vec3 d)
{
    return (box_tree_ray){vec3_sub(p, t->middle), {1 / d.x, 1 / d.y, 1 / d.z}};
}

/* Narrows the range of distances along a ray to those between two planes of a box. A ray in one of the planes (NaN)
 * may miss the box: no item touches them. */
static inline void box_tree_clip(double from, double to, double inverse, double *low, double *high)
{
    const double a = from * inverse, b = to * inverse, near = a < b ? a : b, far = a < b ? b : a;
    *low = near > *low ? near : *low;
    *high = far < *high ? far : *high;
}

/* The distance at which a ray enters a node, 0 if it begins there; INFINITY: it does not, or not before `within`. */
static inline double box_tree_entry(const box_tree_bounds *b, const box_tree_ray *r, double within)
{
    double low = 0, high = within;
    box_tree_clip(b->min[0] - r->p.x, b->max[0] - r->p.x, r->inverse.x, &low, &high);
    box_tree_clip(b->min[1] - r->p.y, b->max[1] - r->p.y, r->inverse.y, &low, &high);
    box_tree_clip(b->min[2] - r->p.z, b->max[2] - r->p.z, r->inverse.z, &low, &high);
    return low <= high ? low : INFINITY;
}

/* Adds a node that a ray enters before `within` to those that are still to be searched. */
static inline void box_tree_push_on_ray(const box_tree *t, box_tree_walk *w, box_tree_node n,
                                        const box_tree_ray *r, double within)
{
    const double entry = box_tree_entry(&t->box[n.node], r, within);
    n.distance2 = entry * entry;
    w->stack[w->depth] = n;
    w->depth += entry < INFINITY;
}

/* Begins a walk along a ray, for box_tree_next_on_ray. */
static inline void box_tree_begin_ray(const box_tree *t, box_tree_walk *w, const box_tree_ray *r,
                                      double within)
{
    w->depth = 0;
    box_tree_push_on_ray(t, w, (box_tree_node){0, 0, t->count, 0}, r, within);
}

/* Moves to the next leaf whose box the ray enters before `within`, which may decrease during the walk. False: there
 * is none. */
static inline bool box_tree_next_on_ray(const box_tree *t, box_tree_walk *w, const box_tree_ray *r,
                                        double within)
{
    while (w->depth > 0) {
        const box_tree_node n = w->stack[--w->depth];
        if (!(n.distance2 < within * within)) continue;
        if (n.count <= BOX_TREE_LEAF) {
            box_tree_set_leaf(w, &n);
            return true;
        }
        box_tree_node left, right;
        box_tree_halves(&n, &left, &right);
        box_tree_push_on_ray(t, w, right, r, within);
        box_tree_push_on_ray(t, w, left, r, within);
    }
    return false;
}

#endif
