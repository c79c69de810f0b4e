// SPDX-License-Identifier: Apache-2.0
/* curve_distance: the distance of a place from the nearest curve of a patch, or of all patches. World units.
 * Immutable after construction, any thread.
 */
#ifndef HEXAD_SAMPLING_SIZING_CURVE_DISTANCE_H
#define HEXAD_SAMPLING_SIZING_CURVE_DISTANCE_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/field/patches.h"

typedef struct curve_distance curve_distance;

/* Samples the curves at every `step` > 0. `joined`: all patches count as patch 0. The caller frees the
 * result. Errors: limit_memory; cancelled, if the pool (NULL: none) is stopped. */
curve_distance *curve_distance_new(const field_patches *patches, bool joined, double step,
                                   const threads *pool, error *e);
void curve_distance_free(curve_distance *d);

/* The distance of x from the curves of a patch; INFINITY without curves. It is too large by at most (step /
 * 2)^2 over twice the distance. */
double curve_distance_at(const curve_distance *d, uint32_t patch, vec3 x);

/* curve_distance_at that also returns the nearest sample; *nearest is unchanged for a patch without
 * curves. */
double curve_distance_nearest(const curve_distance *d, uint32_t patch, vec3 x, vec3 *nearest);

#endif
