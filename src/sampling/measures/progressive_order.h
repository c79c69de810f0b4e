// SPDX-License-Identifier: Apache-2.0
/* progressive_order: an order of points in which each prefix is spread evenly over the surface.
 *
 * Farthest-point order (Gonzalez 1985, "Clustering to minimize the maximum intercluster distance"), within 2
 * %: each point is at least PROGRESSIVE_ORDER_BATCH times as far from the points before it as the farthest
 * one. Points of one batch are chosen in the order of their places, so that consecutive choices use the same
 * memory. The distance of two points is their distance in space over the mean of their spacings. Points of
 * different pieces and of opposite walls (sites.h) count as PROGRESSIVE_ORDER_APART times as far apart: the
 * walls of a thin plate get points of their own, and small pieces beside a large one do not precede the
 * points that cover it.
 *
 * The points are the leaves of a tree of boxes. Each node holds its farthest point, so the root holds the
 * next one; a new point changes only nodes closer to it than their farthest point is to the earlier points.
 * The sum over all points is O(n log n) on surfaces.
 */
#ifndef HEXAD_SAMPLING_MEASURES_PROGRESSIVE_ORDER_H
#define HEXAD_SAMPLING_MEASURES_PROGRESSIVE_ORDER_H

#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/vec3.h"

/* Larger: thin parts approach the distances of separate walls, and prefixes with fewer points than pieces are
 * less even in space. measurements/blue_noise has both. */
#define PROGRESSIVE_ORDER_APART 3.0
/* Smaller: faster, and prefixes are less even. */
#define PROGRESSIVE_ORDER_BATCH 0.98

typedef struct progressive_order_input {
    size_t count; /* of points, at least 1 */
    const vec3 *position;
    const double *spacing; /* requested at each, > 0 */
    const uint32_t *piece; /* of the surface, of each point; NULL: there is one */
    /* As in measures_input. */
    size_t copy_count;
    const vec3 *copy_normal;
    const uint32_t *copy_point, *copy_patch;
    const uint8_t *copy_flags;
    const uint32_t (*patch_labels)[2]; /* see sites.h; NULL: no labels */
} progressive_order_input;

/* order[k]: the k-th point; order[0] is 0. Runs on the calling thread; the
 * pool can stop it. Errors: limit_memory, cancelled. */
bool progressive_order(const progressive_order_input *in, const threads *pool, uint32_t *order, error *e);

#endif
