/* point_tree: the nearest of some points to any place, by a tree of halves (Bentley 1975).
 *
 * Looking is safe in any number of threads. The points stay the caller's, and where they are.
 */
#ifndef HEXAD_GEOMETRY_POINT_TREE_H
#define HEXAD_GEOMETRY_POINT_TREE_H

#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "geometry/vec3.h"

typedef struct point_tree point_tree;

/* Of 1 to 2^32 - 1 points. NULL and limit_memory when memory is out. */
point_tree *point_tree_new(const vec3 *points, size_t count, error *e);
void point_tree_free(point_tree *n);

/* The point nearest to x, and how far it is; or any that is no farther than `enough`, which is found sooner. */
uint32_t point_tree_nearest(const point_tree *n, vec3 x, double enough, double *distance);

/* Calls `visit` for each point within `reach` of x, ends included. */
typedef void (*point_tree_visit)(void *context, uint32_t point);
void point_tree_within(const point_tree *n, vec3 x, double reach, point_tree_visit visit, void *context);

/* Halves points for a tree: puts order[count / 2] in its place along the longest side of their box, no point before it higher and
 * none after it lower. Returns that axis. `count` > 0. */
int point_tree_halve(const vec3 *points, uint32_t *order, size_t count);

#endif
