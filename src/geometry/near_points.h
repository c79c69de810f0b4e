/* near_points: which of some points are near a place, by point_bins, or where many points share a bin by a point_tree.
 *
 * Looking is safe in any number of threads. The points stay the caller's, and where they are.
 */
#ifndef HEXAD_GEOMETRY_NEAR_POINTS_H
#define HEXAD_GEOMETRY_NEAR_POINTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/vec3.h"

typedef struct near_points near_points;

/* Of 1 to 2^32 - 1 points. NULL and limit_memory when memory is out, or cancelled. */
near_points *near_points_new(const vec3 *points, size_t count, threads *pool, error *e);
void near_points_free(near_points *n);

/* The point nearest to x, and how far it is; or any that is no farther than `enough`, which is found sooner. Among equally near
 * points any. */
uint32_t near_points_nearest(const near_points *n, vec3 x, double enough, double *distance);

/* Calls `visit` for each point within `reach` of x, ends included, in no order that means anything. */
typedef void (*near_points_visit)(void *context, uint32_t point);
void near_points_within(const near_points *n, vec3 x, double reach, near_points_visit visit, void *context);

#endif
