/* moving_points: how near a place the nearest of some points is, when a few of them move and the others stay.
 *
 * Those that stay are looked up by near_points, those that move one by one. The arrays stay the caller's; what moves does so in
 * `points`. Looking is safe in any number of threads while nothing moves.
 */
#ifndef HEXAD_GEOMETRY_MOVING_POINTS_H
#define HEXAD_GEOMETRY_MOVING_POINTS_H

#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/vec3.h"

typedef struct moving_points moving_points;

/* Creates the structure for `count` points, of which the points with the ascending indices `moving` may move. On failure NULL
 * and limit_memory or cancelled. */
moving_points *moving_points_new(const vec3 *points, size_t count, const uint32_t *moving,
                                 size_t moving_count, threads *pool, error *e);
void moving_points_free(moving_points *m);

/* The squared distance from x to the nearest point but `except`, which is one of those that move; INFINITY where there
 * is none. */
double moving_points_nearest2(const moving_points *m, vec3 x, uint32_t except);

#endif
