// SPDX-License-Identifier: Apache-2.0
#include "geometry/space/box_tree.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/space/point_tree.h"

/* Number of nodes of a tree with `count` items. */
static size_t nodes_for(size_t count)
{
    size_t nodes = 1;
    for (; count > BOX_TREE_LEAF; count -= count / 2) nodes = 2 * nodes + 1;
    return nodes;
}

size_t box_tree_bytes(size_t count)
{
    return count * sizeof(uint32_t) + nodes_for(count) * sizeof(box_tree_bounds);
}

/* The items from which a tree is built. */
typedef struct items {
    const vec3 *centre;
    box_tree_box *box_of;
    const void *context;
    const threads *pool;
} items;

/* The nearest floats are at most half of the distance between neighbouring floats away: the next ones are beyond
 * x, also after rounding errors of x. */
static float float_below(double x)
{
    return nextafterf((float)x, -INFINITY);
}

static float float_above(double x)
{
    return nextafterf((float)x, INFINITY);
}

static box_tree_bounds bounds_of(bbox box, vec3 middle)
{
    const vec3 min = vec3_sub(box.min, middle), max = vec3_sub(box.max, middle);
    return (box_tree_bounds){{float_below(min.x), float_below(min.y), float_below(min.z)},
                             {float_above(max.x), float_above(max.y), float_above(max.z)}};
}

/* Builds a node of the items order[first] .. order[first + count - 1]. Incomplete if the pool is stopped. */
static bbox build(box_tree *t, const items *i, size_t node, size_t first, size_t count)
{
    bbox box = bbox_empty();
    if (count <= BOX_TREE_LEAF) {
        for (size_t k = first; k < first + count; k++)
            box = bbox_unite(box, i->box_of(i->context, t->order[k]));
    } else if (!threads_stopped(i->pool)) {
        const size_t half = count / 2;
        point_tree_halve(i->centre, t->order + first, count);
        box = bbox_unite(build(t, i, 2 * node + 1, first, half),
                         build(t, i, 2 * node + 2, first + half, count - half));
    }
    t->box[node] = bounds_of(box, t->middle);
    return box;
}

bool box_tree_make(size_t count, const vec3 *centre, box_tree_box *box_of, const void *context,
                   const threads *pool, const char *what, box_tree *out, error *e)
{
    bbox centres = bbox_empty();
    for (size_t k = 0; k < count; k++) centres = bbox_include(centres, centre[k]);
    box_tree t = {count, mem_array(count, sizeof *t.order, what, e),
                  count > 0 ? vec3_scale(vec3_add(centres.min, centres.max), 0.5) : (vec3){0, 0, 0},
                  mem_array(nodes_for(count), sizeof *t.box, what, e)};
    if (!t.order || !t.box) {
        box_tree_free(&t);
        return false;
    }
    for (size_t k = 0; k < count; k++) t.order[k] = (uint32_t)k;
    build(&t, &(items){centre, box_of, context, pool}, 0, 0, count);
    if (threads_stopped(pool)) {
        box_tree_free(&t);
        return error_set(e, ERROR_CANCELLED, "stopped");
    }
    *out = t;
    return true;
}

void box_tree_free(box_tree *t)
{
    free(t->order);
    free(t->box);
    *t = (box_tree){0};
}

void box_tree_extend(box_tree *t, size_t at, vec3 x)
{
    box_tree_node n = {0, 0, t->count, 0}, left, right;
    for (;;) {
        box_tree_bounds *box = &t->box[n.node];
        for (int axis = 0; axis < 3; axis++) {
            const double to = vec3_get(x, axis) - vec3_get(t->middle, axis);
            box->min[axis] = fminf(box->min[axis], float_below(to));
            box->max[axis] = fmaxf(box->max[axis], float_above(to));
        }
        if (n.count <= BOX_TREE_LEAF) return;
        box_tree_halves(&n, &left, &right);
        n = at < right.first ? left : right;
    }
}
