// SPDX-License-Identifier: Apache-2.0
/* triangle_tree: the triangles of a mesh in a box_tree (geometry/space/box_tree.h, with its complexity), to
 * find the closest triangle and the intersections with a line. If the boxes of the triangles overlap too much, because
 * most of them are slivers that are not parallel to an axis, near triangles are searched in a second tree: of up to 16 pieces of
 * each triangle. Immutable after construction. All searches:
 * any thread, also the first search of a lazy tree (it locks). Lengths are those of the mesh.
 */
#ifndef HEXAD_SURFACE_TRIANGLES_TRIANGLE_TREE_H
#define HEXAD_SURFACE_TRIANGLES_TRIANGLE_TREE_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"
#include "geometry/space/triangle.h"

typedef struct triangle_tree triangle_tree;

/* Builds the tree. `m` has at least one triangle; it is not owned and outlives the tree. `pool`
 * may be NULL; only its flag is used. NULL: limit_memory, cancelled. */
triangle_tree *triangle_tree_new(const mesh *m, const threads *pool, error *e);
/* A tree that is built at the first search: for the parts of a divided mesh, most of which may never be
 * searched. Use it for small meshes only (mesh_faces: up to 65 536 triangles, about 2 MB, slivers 32 MB): a search returns
 * no error, so that the process is aborted if memory is out at the first search. */
triangle_tree *triangle_tree_new_lazy(const mesh *m);
void triangle_tree_free(triangle_tree *n); /* accepts NULL */

/* Returns the closest triangle. `weight`: barycentric weights of the closest point of it. */
size_t triangle_tree_find(const triangle_tree *n, vec3 p, double weight[3]);

/* triangle_tree_find, faster if triangle `start` is near p. */
size_t triangle_tree_find_from(const triangle_tree *n, vec3 p, size_t start, double weight[3]);

/* Finds the closest triangle if its squared distance is less than *distance2, and sets *distance2 to it.
 * False: there is none. */
bool triangle_tree_find_nearer(const triangle_tree *n, vec3 p, double *distance2, size_t *nearest);

/* A call for the triangle `n` of tree `tree`, with the corners *t. */
typedef void triangle_tree_visitor(void *context, size_t tree, size_t n, const triangle *t);

/* Visits all triangles whose squared distance from p is at most `distance2`, in any order, each once or several
 * times; `tree` is 0. */
void triangle_tree_visit_near(const triangle_tree *n, vec3 p, double distance2, triangle_tree_visitor *visit,
                              void *context);

/* The box of all triangles. */
bbox triangle_tree_box(const triangle_tree *n);

/* Whether a triangle with the corners *t is accepted by a search. `n`: its number in its own tree. */
typedef bool triangle_tree_accept(const void *context, size_t n, const triangle *t);

#define TRIANGLE_TREE_NONE UINT32_MAX /* no triangle */

/* Intersections of a line, seen from one of its points. */
typedef struct line_crossings {
    /* distances of the nearest crossings in both directions; INFINITY: there is none */
    double ahead, behind;
    /* sum over the crossings ahead: +1 where the line leaves through a triangle, -1 where it enters */
    int winding;
} line_crossings;

/* Intersects the line through p in the direction of the unit vector d with all triangles except `skip` (or
 * TRIANGLE_TREE_NONE). */
line_crossings triangle_tree_cross(const triangle_tree *n, vec3 p, vec3 d, uint32_t skip);

size_t triangle_tree_bytes(const triangle_tree *n);

/* A box_tree over several trees. */
typedef struct triangle_forest triangle_forest;

/* `count` > 0 trees, which are owned by the caller and outlive the forest. NULL: limit_memory. */
triangle_forest *triangle_forest_new(const triangle_tree *const *tree, size_t count, error *e);
void triangle_forest_free(triangle_forest *n); /* accepts NULL */

/* Returns the tree with the closest triangle, the first one at equal distances, and sets *nearest to that
 * triangle. */
size_t triangle_forest_find(const triangle_forest *n, vec3 p, size_t *nearest);

/* Finds the closest point of the accepted triangles of all trees that is nearer than `within`. False:
 * there is none. */
bool triangle_forest_find_accepted(const triangle_forest *n, vec3 p, double within,
                                   triangle_tree_accept *accept, const void *context, vec3 *place);

/* triangle_tree_cross over all triangles of all trees. */
line_crossings triangle_forest_cross(const triangle_forest *n, vec3 p, vec3 d);

/* triangle_forest_find if the closest triangle of one tree is known: replaces *tree and *nearest if another
 * tree has a closer triangle, or is earlier at the same distance. */
void triangle_forest_improve(const triangle_forest *n, vec3 p, size_t *tree, size_t *nearest);

/* The nearest crossing of a ray with triangles. */
typedef struct ray_crossing {
    double distance; /* INFINITY: there is none */
    size_t tree, triangle;
} ray_crossing;

/* The nearest crossing, at a distance below `within`, of the ray from p in the direction of the unit vector d with all
 * triangles except triangle skip->triangle of skip->tree. */
ray_crossing triangle_forest_first_crossing(const triangle_forest *n, vec3 p, vec3 d, double within,
                                            const ray_crossing *skip);

/* triangle_tree_visit_near over all trees. */
void triangle_forest_visit_near(const triangle_forest *n, vec3 p, double distance2,
                                triangle_tree_visitor *visit, void *context);

/* The box of all trees. */
bbox triangle_forest_box(const triangle_forest *n);

size_t triangle_forest_bytes(const triangle_forest *n);

#endif
