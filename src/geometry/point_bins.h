/* point_bins: the nearest of points that are spread evenly over a surface to places near it, by bins of a box.
 *
 * Built in a tenth of the time of a point_tree, which is for points that crowd or places far away. Looking is safe in any number
 * of threads. The points stay the caller's, and where they are.
 */
#ifndef HEXAD_GEOMETRY_POINT_BINS_H
#define HEXAD_GEOMETRY_POINT_BINS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/vec3.h"

typedef struct point_bins point_bins;

/* Of 1 to 2^32 - 1 points. NULL and limit_memory when memory is out, or cancelled. */
point_bins *point_bins_new(const vec3 *points, size_t count, threads *pool, error *e);
void point_bins_free(point_bins *b);

/* Whether so many points share a bin that to look into one takes long. */
bool point_bins_are_crowded(const point_bins *b);

/* As point_tree_nearest. */
uint32_t point_bins_nearest(const point_bins *b, vec3 x, double enough, double *distance);

/* Calls `visit` for each point within `reach` of x, ends included. */
typedef void (*point_bins_visit)(void *context, uint32_t point);
void point_bins_within(const point_bins *b, vec3 x, double reach, point_bins_visit visit, void *context);

#endif
