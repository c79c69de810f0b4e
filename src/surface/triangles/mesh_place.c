// SPDX-License-Identifier: Apache-2.0
#include "surface/triangles/mesh_place.h"

#include <math.h>

/* Cosines that differ by at most this are equal. */
static const double SAME_COSINE = 1e-6;

/* The triangle that has the point, of those visited. */
typedef struct choice {
    const vec3 *normal;
    double parallel; /* |cosine| between its normal and `normal`; 0 without a given normal; -1: no area */
    size_t tree, triangle;
    triangle corners;
    bool is_found;
} choice;

static double parallel_to(const triangle *t, const vec3 *normal)
{
    const vec3 own = vec3_unit(vec3_cross(vec3_sub(t->b, t->a), vec3_sub(t->c, t->a)));
    return !(vec3_norm2(own) > 0) ? -1 : normal ? fabs(vec3_dot(own, *normal)) : 0;
}

static bool is_before(size_t tree, size_t n, const choice *c)
{
    return tree < c->tree || (tree == c->tree && n < c->triangle);
}

static void take(choice *c, double parallel, size_t tree, size_t n, const triangle *t)
{
    *c = (choice){c->normal, parallel, tree, n, *t, true};
}

/* Finds the largest cosine. */
static void compare(void *context, size_t tree, size_t n, const triangle *t)
{
    choice *c = context;
    const double parallel = parallel_to(t, c->normal);
    if (!c->is_found || parallel > c->parallel) take(c, parallel, tree, n, t);
}

/* Finds the first triangle of those with this cosine. */
static void choose(void *context, size_t tree, size_t n, const triangle *t)
{
    choice *c = context;
    if (is_before(tree, n, c) && parallel_to(t, c->normal) >= c->parallel - SAME_COSINE)
        take(c, c->parallel, tree, n, t);
}

static void set_place(const choice *c, vec3 x, mesh_place *out)
{
    out->triangle = (uint32_t)c->triangle;
    triangle_weights(&c->corners, x, out->weight);
    out->distance = sqrt(triangle_distance2(&c->corners, x));
}

/* The largest squared distance of triangles that are as near as the nearest one. */
static double as_near(double distance2, bbox box)
{
    static const double rounding = 1 + 1e-12; /* of points far away from the box */
    const double distance = rounding * sqrt(distance2) + MESH_PLACE_ROUNDING * bbox_longest(box);
    return distance * distance;
}

bool mesh_place_find(const triangle_tree *tree, vec3 x, const vec3 *normal, double within, mesh_place *out)
{
    choice c = {.normal = normal};
    size_t nearest;
    double distance2 = nextafter(within * within, INFINITY);
    if (!triangle_tree_find_nearer(tree, x, &distance2, &nearest)) return false;
    distance2 = as_near(distance2, triangle_tree_box(tree));
    triangle_tree_visit_near(tree, x, distance2, compare, &c);
    triangle_tree_visit_near(tree, x, distance2, choose, &c);
    set_place(&c, x, out);
    return true;
}

/* as_near for the nearest triangle of all trees. False: it is farther away than `within`. */
static bool find_nearest(const triangle_forest *trees, vec3 x, double within, double *distance2)
{
    vec3 nearest;
    if (!triangle_forest_find_accepted(trees, x, nextafter(within, INFINITY), NULL, NULL, &nearest))
        return false;
    *distance2 = as_near(vec3_norm2(vec3_sub(nearest, x)), triangle_forest_box(trees));
    return true;
}

bool mesh_place_find_among(const triangle_forest *trees, vec3 x, const vec3 *normal, double within,
                           size_t *tree, mesh_place *out)
{
    choice c = {.normal = normal};
    double distance2;
    if (!find_nearest(trees, x, within, &distance2)) return false;
    triangle_forest_visit_near(trees, x, distance2, compare, &c);
    triangle_forest_visit_near(trees, x, distance2, choose, &c);
    *tree = c.tree;
    set_place(&c, x, out);
    return true;
}

/* The choices of the first trees, ascending. */
typedef struct tree_choices {
    size_t most, count;
    mesh_place_in *out;
    vec3 x;
} tree_choices;

/* Adds a triangle with area, or replaces a later one of its tree. */
static void choose_of_tree(void *context, size_t tree, size_t n, const triangle *t)
{
    tree_choices *c = context;
    size_t at = 0;
    if (parallel_to(t, NULL) < 0) return;
    while (at < c->count && c->out[at].tree < tree) at++;
    const bool is_there = at < c->count && c->out[at].tree == tree;
    if (is_there && c->out[at].place.triangle <= n) return;
    if (!is_there) {
        if (c->count == c->most && at == c->most) return;
        if (c->count < c->most) c->count++;
        for (size_t k = c->count - 1; k > at; k--) c->out[k] = c->out[k - 1];
    }
    c->out[at].tree = tree;
    set_place(&(choice){.triangle = n, .corners = *t}, c->x, &c->out[at].place);
}

size_t mesh_place_find_each(const triangle_forest *trees, vec3 x, double within, size_t most,
                            mesh_place_in *out)
{
    tree_choices c = {.most = most, .out = out, .x = x};
    double distance2;
    if (!find_nearest(trees, x, within, &distance2)) return 0;
    triangle_forest_visit_near(trees, x, distance2, choose_of_tree, &c);
    if (c.count == 0) /* no area */
        c.count = mesh_place_find_among(trees, x, NULL, within, &out->tree, &out->place);
    return c.count;
}

vec3 mesh_place_normal(const mesh *m, const mesh_place *place)
{
    return vec3_unit(mesh_across(m, place->triangle));
}
