// SPDX-License-Identifier: Apache-2.0
/* point_tree: a k-d tree of points of any distribution, to find the point nearest to any place and the points
 * within a distance of it.
 *
 * Complexity for n points: construction O(n log n); memory 5 n bytes; a search O(log n + points found) for
 * places near the points, O(n) at worst.
 * Searches: any number of threads. The points are not owned and must not move. Source: Bentley 1975,
 * "Multidimensional Binary Search Trees Used for Associative Searching".
 */
#ifndef HEXAD_GEOMETRY_SPACE_POINT_TREE_H
#define HEXAD_GEOMETRY_SPACE_POINT_TREE_H

#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "geometry/space/vec3.h"

typedef struct point_tree point_tree;

/* `count`: 1 to 2^32 - 2. NULL: limit_memory. */
point_tree *point_tree_new(const vec3 *points, size_t count, error *e);
void point_tree_free(point_tree *n); /* accepts NULL */

/* Returns the point nearest to x, or any point within the distance `enough`, which takes less
 * time. *distance: its distance from x. */
uint32_t point_tree_nearest(const point_tree *n, vec3 x, double enough, double *distance);

/* Calls `visit` for each point whose distance from x is at most `reach`, in no particular order. */
typedef void (*point_tree_visit)(void *context, uint32_t point);
void point_tree_within(const point_tree *n, vec3 x, double reach, point_tree_visit visit, void *context);

/* Partitions points for a tree along the longest side of their box: order[count / 2] becomes the median, no
 * point before it is higher and no point after it is lower. Returns the axis. `count` > 0. O(count) on
 * average. */
int point_tree_halve(const vec3 *points, uint32_t *order, size_t count);

#endif
