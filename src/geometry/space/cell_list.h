// SPDX-License-Identifier: Apache-2.0
/* cell_list: a uniform cell list of points, to find the point nearest to a place and the points within a
 * distance of a place.
 *
 * The cells are cubes in a dense array over the bounding box of the points, at most two per point. If many
 * points share cells, a point_tree replaces the cells (geometry/space/point_tree.h).
 * Complexity for n points that are spread evenly over a surface: construction O(n), a tenth of the time of a
 * point_tree; memory 12 n bytes; a search from a place near the surface O(1), plus O(1) per point found. A
 * search from a place at distance d visits about (d / edge)^3 cells.
 * Searches: any number of threads, while no point moves. The points are not owned. Only the moving points of
 * a moving_cell_list may move.
 */
#ifndef HEXAD_GEOMETRY_SPACE_CELL_LIST_H
#define HEXAD_GEOMETRY_SPACE_CELL_LIST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/vec3.h"

typedef struct cell_list cell_list;

/* `count`: 1 to 2^32 - 2. `pool` may be NULL. NULL: limit_memory, cancelled. */
cell_list *cell_list_new(const vec3 *points, size_t count, threads *pool, error *e);
void cell_list_free(cell_list *l); /* accepts NULL */

/* Whether a point_tree replaces the cells. */
bool cell_list_is_dense(const cell_list *l);

/* Returns the point nearest to x, or any point within the distance `enough`, which takes less
 * time. *distance: its distance from x. At equal distances any point is returned. */
uint32_t cell_list_nearest(const cell_list *l, vec3 x, double enough, double *distance);

/* Calls `visit` for each point whose distance from x is at most `reach`, in no particular order. */
typedef void (*cell_list_visit)(void *context, uint32_t point);
void cell_list_within(const cell_list *l, vec3 x, double reach, cell_list_visit visit, void *context);

/* A cell list in which some of the points move between searches. */
typedef struct moving_cell_list moving_cell_list;

/* `moving`: the ascending indices of the points that may move; not owned. A search takes O(moving_count) more
 * time. NULL: limit_memory, cancelled. */
moving_cell_list *moving_cell_list_new(const vec3 *points, size_t count, const uint32_t *moving,
                                       size_t moving_count, threads *pool, error *e);
void moving_cell_list_free(moving_cell_list *m); /* accepts NULL */

/* The squared distance from x to the nearest point other than the moving point `except`; INFINITY if there is
 * no other point. */
double moving_cell_list_nearest2(const moving_cell_list *m, vec3 x, uint32_t except);

#endif
