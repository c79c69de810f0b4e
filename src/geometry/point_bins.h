/* point_bins: the nearest of points that are spread evenly over a surface to places near it, by bins of a box.
 *
 * Built in a tenth of the time of a point_tree, which is for points of uneven density and for distant places. Any number of
 * threads may search. The points belong to the caller and must not move.
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

/* Whether bins contain too many points for a fast search; a point_tree is faster then. */
bool point_bins_are_dense(const point_bins *b);

/* As point_tree_nearest. */
uint32_t point_bins_nearest(const point_bins *b, vec3 x, double enough, double *distance);

/* Calls `visit` for each point within `reach` of x, ends included. */
typedef void (*point_bins_visit)(void *context, uint32_t point);
void point_bins_within(const point_bins *b, vec3 x, double reach, point_bins_visit visit, void *context);

#endif
