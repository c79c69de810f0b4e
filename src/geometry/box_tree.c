#include "geometry/box_tree.h"

#include <stdbool.h>
#include <stdlib.h>

#include "base/memory.h"
#include "geometry/morton.h"

static const char WHAT[] = "a tree of boxes";

struct box_tree {
    size_t leaves; /* a power of two */
    bbox
        *node; /* 1: the root; of n: 2 n and 2 n + 1; the last `leaves` of them: the boxes, then empty ones */
    uint32_t *box;  /* of each leaf */
    uint32_t *leaf; /* of each box */
    uint32_t *found;
};

static bool fill(box_tree *t, const bbox *box, size_t count, error *e)
{
    vec3 *middle = mem_array(count, sizeof *middle, WHAT, e);
    bool ok = middle;
    for (size_t k = 0; ok && k < count; k++) middle[k] = vec3_scale(vec3_add(box[k].min, box[k].max), 0.5);
    ok = ok && (count == 0 || morton_order(middle, count, NULL, t->box, e));
    free(middle);
    for (size_t k = 0; ok && k < t->leaves; k++)
        t->node[t->leaves + k] = k < count ? box[t->box[k]] : bbox_empty();
    for (size_t k = t->leaves - 1; ok && k > 0; k--)
        t->node[k] = bbox_unite(t->node[2 * k], t->node[2 * k + 1]);
    for (size_t k = 0; ok && k < count; k++) t->leaf[t->box[k]] = (uint32_t)k;
    return ok;
}

box_tree *box_tree_new(const bbox *box, size_t count, error *e)
{
    box_tree *t = mem_alloc(sizeof *t);
    for (t->leaves = 1; t->leaves < count;) t->leaves *= 2;
    t->node = mem_array(2 * t->leaves, sizeof *t->node, WHAT, e);
    t->box = mem_array(count, sizeof *t->box, WHAT, e);
    t->leaf = mem_array(count, sizeof *t->leaf, WHAT, e);
    t->found = mem_array(count, sizeof *t->found, WHAT, e);
    if (t->node && t->box && t->leaf && t->found && fill(t, box, count, e)) return t;
    box_tree_free(t);
    return NULL;
}

void box_tree_free(box_tree *t)
{
    if (!t) return;
    free(t->node);
    free(t->box);
    free(t->leaf);
    free(t->found);
    free(t);
}

void box_tree_extend(box_tree *t, uint32_t box, vec3 x)
{
    for (size_t k = t->leaves + t->leaf[box]; k > 0 && !bbox_contains(t->node[k], x); k /= 2)
        t->node[k] = bbox_include(t->node[k], x);
}

static bool do_meet(const bbox *a, const bbox *b)
{
    return a->min.x <= b->max.x && b->min.x <= a->max.x && a->min.y <= b->max.y && b->min.y <= a->max.y &&
           a->min.z <= b->max.z && b->min.z <= a->max.z;
}

static void look(box_tree *t, size_t node, const bbox *where, size_t *count)
{
    if (!do_meet(&t->node[node], where)) return;
    if (node >= t->leaves) {
        t->found[(*count)++] = t->box[node - t->leaves];
        return;
    }
    look(t, 2 * node, where, count);
    look(t, 2 * node + 1, where, count);
}

static int compare(const void *left, const void *right)
{
    const uint32_t *a = left, *b = right;
    return (*a > *b) - (*a < *b);
}

const uint32_t *box_tree_find(box_tree *t, vec3 x, double reach, size_t *count)
{
    const bbox where = bbox_grow((bbox){x, x}, reach);
    *count = 0;
    look(t, 1, &where, count);
    if (*count > 1) qsort(t->found, *count, sizeof *t->found, compare);
    return t->found;
}
