// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/progressive_order.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/space/bbox.h"
#include "geometry/space/point_tree.h"
#include "sampling/measures/sites.h"

/* Maximum points of a leaf. With 8, a million points take a tenth longer. */
enum { LEAF = 16 };

static const char what[] = "the order of the points";

/* A point in a leaf. */
typedef struct entry {
    vec3 position;
    double spacing;
    double far; /* squared distance from the nearest chosen point, in spacings; TAKEN: this point is chosen */
    uint32_t index, piece;
} entry;

static const double TAKEN = -1;

typedef struct node {
    float low[3], high[3], largest_spacing;
    double far;           /* maximum of `far` over its points */
    uint32_t index;       /* index of the point with this maximum; the lowest one if several have it */
    uint32_t entry_index; /* entry of this point */
} node;

typedef struct order_tree {
    const progressive_order_input *in;
    sites sites;
    uint32_t *side, *patch; /* per site */
    vec3 *normal;
    bool *one_sided;
    entry *entry;
    vec3 *facing; /* per entry: single_normal; a separate array, since few visited entries need it */
    node *node;   /* children of k: 2 k + 1 and 2 k + 2 */
    size_t first_leaf;
    vec3 middle; /* centre of the points: floats are sufficiently exact relative to it */
} order_tree;

/* ---- building */

static bool is_before(double far, uint32_t index, const node *than)
{
    return far > than->far || (far == than->far && index < than->index);
}

static void take_farthest_entry(order_tree *t, size_t k, size_t begin, size_t end)
{
    node *n = &t->node[k];
    n->far = -INFINITY;
    for (size_t i = begin; i < end; i++) {
        const entry *p = &t->entry[i];
        if (!is_before(p->far, p->index, n)) continue;
        n->far = p->far;
        n->index = p->index;
        n->entry_index = (uint32_t)i;
    }
}

static void take_farther_child(order_tree *t, size_t k)
{
    const node *a = &t->node[2 * k + 1], *b = &t->node[2 * k + 2];
    const node *from = is_before(b->far, b->index, a) ? b : a;
    node *n = &t->node[k];
    n->far = from->far;
    n->index = from->index;
    n->entry_index = from->entry_index;
}

/* The normal of a point if it has exactly one whose sign is meaningful; otherwise NaN. */
static vec3 single_normal(const order_tree *t, uint32_t index)
{
    const uint32_t k = t->side[index];
    const bool is_single = !t->in->patch_labels && t->side[index + 1] == k + 1 && !t->one_sided[k];
    return is_single ? t->normal[k] : vec3_make(NAN, NAN, NAN);
}

/* A float that is not less than x. */
static float float_above(double x)
{
    const float f = (float)x;
    return f < x ? nextafterf(f, INFINITY) : f;
}

static float float_below(double x)
{
    return -float_above(-x);
}

static void include(const order_tree *t, node *n, const entry *p)
{
    const vec3 x = vec3_sub(p->position, t->middle);
    for (int a = 0; a < 3; a++) {
        n->low[a] = fminf(n->low[a], float_below(vec3_get(x, a)));
        n->high[a] = fmaxf(n->high[a], float_above(vec3_get(x, a)));
    }
    n->largest_spacing = fmaxf(n->largest_spacing, float_above(p->spacing));
}

static void build(order_tree *t, uint32_t *order, size_t k, size_t begin, size_t end)
{
    node *n = &t->node[k];
    for (int a = 0; a < 3; a++) {
        n->low[a] = INFINITY;
        n->high[a] = -INFINITY;
    }
    n->largest_spacing = 0;
    if (k >= t->first_leaf) {
        for (size_t i = begin; i < end; i++) {
            const uint32_t index = order[i];
            t->entry[i] = (entry){t->in->position[index], t->in->spacing[index], INFINITY, index,
                                  t->in->piece ? t->in->piece[index] : 0};
            t->facing[i] = single_normal(t, index);
            include(t, n, &t->entry[i]);
        }
        take_farthest_entry(t, k, begin, end);
        return;
    }
    const size_t middle = begin + (end - begin) / 2;
    point_tree_halve(t->in->position, order + begin, end - begin);
    build(t, order, 2 * k + 1, begin, middle);
    build(t, order, 2 * k + 2, middle, end);
    for (size_t c = 2 * k + 1; c <= 2 * k + 2; c++) {
        const node *child = &t->node[c];
        for (int a = 0; a < 3; a++) {
            n->low[a] = fminf(n->low[a], child->low[a]);
            n->high[a] = fmaxf(n->high[a], child->high[a]);
        }
        n->largest_spacing = fmaxf(n->largest_spacing, child->largest_spacing);
    }
    take_farther_child(t, k);
}

static void free_tree(order_tree *t)
{
    free(t->side);
    free(t->patch);
    free(t->normal);
    free(t->one_sided);
    free(t->entry);
    free(t->facing);
    free(t->node);
}

static bool make_tree(const progressive_order_input *in, uint32_t *order, order_tree *t, error *e)
{
    const size_t n = in->count, copies = in->copy_count;
    size_t leaves = 1;
    while (leaves * LEAF < n) leaves *= 2;
    *t = (order_tree){.in = in, .first_leaf = leaves - 1};
    t->side = mem_array(n + 1, sizeof *t->side, what, e);
    t->patch = mem_array(copies, sizeof *t->patch, what, e);
    t->normal = mem_array(copies, sizeof *t->normal, what, e);
    t->one_sided = mem_array(copies, sizeof *t->one_sided, what, e);
    t->entry = mem_array(n, sizeof *t->entry, what, e);
    t->facing = mem_array(n, sizeof *t->facing, what, e);
    t->node = mem_array(2 * leaves - 1, sizeof *t->node, what, e);
    if (!t->side || !t->patch || !t->normal || !t->one_sided || !t->entry || !t->facing || !t->node)
        return false;
    const sites_copies list = {copies, in->copy_normal, in->copy_point, in->copy_patch, in->copy_flags};
    sites_gather(&list, n, t->side, t->normal, t->one_sided, t->patch);
    t->sites = (sites){.side = t->side,
                       .normal = t->normal,
                       .one_sided = t->one_sided,
                       .patch = t->patch,
                       .patch_labels = in->patch_labels};
    bbox box = bbox_empty();
    for (size_t i = 0; i < n; i++) {
        box = bbox_include(box, in->position[i]);
        order[i] = (uint32_t)i;
    }
    t->middle = vec3_scale(vec3_add(box.min, box.max), 0.5);
    build(t, order, 0, 0, n);
    return true;
}

/* ---- choosing */

/* The chosen point, with its position in the tree. */
typedef struct choice {
    vec3 position, local; /* local: relative to t->middle */
    double spacing;
    uint32_t index, entry_index, piece;
    vec3 facing;
} choice;

static bool are_apart(const order_tree *t, const choice *c, size_t at)
{
    const entry *p = &t->entry[at];
    if (p->piece != c->piece) return true;
    const double cosine = vec3_dot(t->facing[at], c->facing);
    return isnan(cosine) ? sites_facing_pair(&t->sites, p->index, c->index) <= SITES_OPPOSITE
                         : cosine <= SITES_OPPOSITE;
}

/* Updates the distance of an entry. False: it has not decreased. */
static bool bring_nearer(const order_tree *t, const choice *c, size_t at)
{
    entry *p = &t->entry[at];
    const double mean = 0.5 * (p->spacing + c->spacing),
                 distance2 = vec3_norm2(vec3_sub(p->position, c->position));
    if (!(distance2 < p->far * mean * mean)) return false;
    double far = distance2 / (mean * mean);
    if (are_apart(t, c, at)) far *= PROGRESSIVE_ORDER_APART * PROGRESSIVE_ORDER_APART;
    if (!(far < p->far)) return false;
    p->far = far;
    return true;
}

/* Lower bound of the squared distance of the node's points from x, which is relative to the middle. */
static double box_distance2(const node *n, vec3 x)
{
    const double dx = fmax(fmax(n->low[0] - x.x, x.x - n->high[0]), 0),
                 dy = fmax(fmax(n->low[1] - x.y, x.y - n->high[1]), 0),
                 dz = fmax(fmax(n->low[2] - x.z, x.z - n->high[2]), 0);
    return dx * dx + dy * dy + dz * dz;
}

/* Whether node k contains the chosen point, or a point that may be nearer to it than to all earlier
 * points. */
static bool is_reached(const order_tree *t, const choice *c, size_t k, size_t begin, size_t end)
{
    const node *n = &t->node[k];
    const double mean = 0.5 * (n->largest_spacing + c->spacing);
    return box_distance2(n, c->local) < n->far * mean * mean ||
           (c->entry_index >= begin && c->entry_index < end);
}

static bool update_leaf(order_tree *t, const choice *c, size_t k, size_t begin, size_t end)
{
    bool changed = c->entry_index >= begin && c->entry_index < end;
    for (size_t i = begin; i < end; i++) changed |= bring_nearer(t, c, i);
    if (changed) take_farthest_entry(t, k, begin, end);
    return changed;
}

/* Updates node k, with the entries begin .. end, for the chosen point. False: nothing has changed. */
static bool update(order_tree *t, const choice *c, size_t k, size_t begin, size_t end)
{
    if (k >= t->first_leaf) return update_leaf(t, c, k, begin, end);
    const size_t middle = begin + (end - begin) / 2, left = 2 * k + 1, right = left + 1;
    bool changed = is_reached(t, c, left, begin, middle) && update(t, c, left, begin, middle);
    changed |= is_reached(t, c, right, middle, end) && update(t, c, right, middle, end);
    if (changed) take_farther_child(t, k);
    return changed;
}

/* State of the ordering. */
typedef struct ordering {
    order_tree tree;
    uint32_t *order;
    size_t count; /* number of chosen points */
} ordering;

static void choose(ordering *o, uint32_t entry_index)
{
    order_tree *t = &o->tree;
    entry *next = &t->entry[entry_index];
    const choice c = {next->position,        vec3_sub(next->position, t->middle),
                      next->spacing,         next->index,
                      entry_index,           next->piece,
                      t->facing[entry_index]};
    o->order[o->count++] = next->index;
    next->far = TAKEN;
    update(t, &c, 0, 0, t->in->count);
}

/* Chooses points of node k until all of its points are within this squared distance of chosen points. */
static void choose_in(ordering *o, size_t k, double least)
{
    const node *n = &o->tree.node[k];
    while (n->far >= least && k >= o->tree.first_leaf) choose(o, n->entry_index);
    if (n->far < least) return;
    choose_in(o, 2 * k + 1, least);
    choose_in(o, 2 * k + 2, least);
}

bool progressive_order(const progressive_order_input *in, const threads *pool, uint32_t *order, error *e)
{
    ordering o = {.order = order};
    bool ok = make_tree(in, order, &o.tree, e);
    const node *root = o.tree.node;
    if (ok) choose(&o, root->entry_index);
    while (ok && o.count < in->count) {
        choose_in(&o, 0, root->far * PROGRESSIVE_ORDER_BATCH * PROGRESSIVE_ORDER_BATCH);
        if (!threads_may_go_on(pool, e)) ok = false;
    }
    free_tree(&o.tree);
    return ok;
}
