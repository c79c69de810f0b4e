// SPDX-License-Identifier: Apache-2.0
/* morton: sorts points along Morton's curve, so that most points that are close in space are close in the
 * order.
 *
 * G. M. Morton 1966, "A computer oriented geodetic data base". The sort is stable for points in one cell of
 * the curve.
 */
#ifndef HEXAD_GEOMETRY_SPACE_MORTON_H
#define HEXAD_GEOMETRY_SPACE_MORTON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/vec3.h"

/* order[k]: the index of the k-th point along the curve. The coordinates of all `count` points are finite.
 * The cells of the curve are finer than the distances of points that cover a surface. `pool` may be NULL.
 * Error: limit_memory. */
bool morton_order(const vec3 *x, size_t count, threads *pool, uint32_t *order, error *e);

/* The position of point k; called by any thread. */
typedef vec3 morton_place(const void *context, size_t k);

/* morton_order of points whose positions are computed, several times each. */
bool morton_order_of(morton_place *place, const void *context, size_t count, threads *pool, uint32_t *order,
                     error *e);

#endif
