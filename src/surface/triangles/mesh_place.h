// SPDX-License-Identifier: Apache-2.0
/* mesh_place: the place of a point on a triangle mesh: a triangle, and a position in it.
 *
 * The exact position decides: the triangle is the one nearest to the point. A point on an edge or at a corner
 * is at the same distance from several triangles; it belongs to one of them by this rule, in which distances
 * that differ by at most MESH_PLACE_ROUNDING of the mesh's longest side are equal:
 *
 * 1. If a normal is given: the triangle whose normal is most nearly parallel to it, in either direction, since
 *    the triangles of a file may be reversed. Cosines that differ by at most 1e-6 are equal.
 * 2. Of these, the one with the lowest index. So coincident triangles, of any orientation, are one sheet: the
 *    first of them has the point, as in mesh_weld.
 *
 * A triangle without area has the point only if all triangles at that distance have no area. The result
 * depends on the mesh, the point and the normal only. Pure functions, any thread. Lengths are those of the
 * mesh.
 */
#ifndef HEXAD_SURFACE_TRIANGLES_MESH_PLACE_H
#define HEXAD_SURFACE_TRIANGLES_MESH_PLACE_H

#include "surface/triangles/triangle_tree.h"

/* Relative to the longest side of the box of the mesh: the rounding of coordinates in single precision. A
 * larger value would take thin walls for one; with a smaller one, a point on an edge whose coordinates were
 * stored in single precision belongs to an arbitrary face. */
#define MESH_PLACE_ROUNDING 1e-7

typedef struct mesh_place {
    uint32_t triangle; /* its index in the mesh */
    double weight[3];  /* barycentric weights of its corners, at least 0, with the sum 1 */
    double distance;   /* of the point from the place */
} mesh_place;

/* Finds the place of the point x on the mesh of the tree. `normal`: unit normal of the surface at the point, or
 * NULL if it is unknown. `within`: maximum distance; INFINITY: any. False, with *out unchanged: all triangles
 * are farther away. */
bool mesh_place_find(const triangle_tree *tree, vec3 x, const vec3 *normal, double within, mesh_place *out);

/* mesh_place_find on the triangles of several trees. *tree: the tree of the place; `triangle` is the index in
 * its mesh. Rule 2 prefers the first tree. */
bool mesh_place_find_among(const triangle_forest *trees, vec3 x, const vec3 *normal, double within,
                           size_t *tree, mesh_place *out);

/* A place in one tree of a forest: `triangle` is the index in the mesh of the tree. */
typedef struct mesh_place_in {
    size_t tree;
    mesh_place place;
} mesh_place_in;

/* All trees that have a place of x which is as near as the nearest one, ascending, at most `most`; each with its
 * place by rule 2. Returns their number; 0: all triangles are farther away than `within`. The first is that of
 * mesh_place_find_among without a normal. */
size_t mesh_place_find_each(const triangle_forest *trees, vec3 x, double within, size_t most,
                            mesh_place_in *out);

/* The unit normal of the triangle of the place; 0 without area. */
vec3 mesh_place_normal(const mesh *m, const mesh_place *place);

#endif
