// SPDX-License-Identifier: Apache-2.0
/* coverage: the distance of a surface from its points.
 *
 * The test places are the centroids of the triangles of the surface's grid cells, projected onto the surface.
 * In an ideal packing the largest distance is 0.58 spacings; beside a vacancy it is 1. Distances are
 * Euclidean: on a wall thinner than the spacing, a place may be near a point of the opposite wall. World
 * space.
 */
#ifndef HEXAD_SAMPLING_SOLVER_PARTICLES_COVERAGE_H
#define HEXAD_SAMPLING_SOLVER_PARTICLES_COVERAGE_H

#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/scan/surface.h"

/* Number of parts that coverage_measure distinguishes: the patches; 1 without patches. */
size_t coverage_parts(const surface *scan);

/* Raises farthest[k] of each part to the largest distance of its places from the nearest point, in spacings
 * of that point. The nearest point may belong to any patch. `count` > 0; `spacing`: per point, > 0.
 * farthest[k] is read: set it to 0 for the true largest distance. With a larger initial value the result is
 * the maximum of both, and the test is faster, because smaller distances are not searched. Errors:
 * limit_memory, cancelled. Deterministic for any number of threads. */
bool coverage_measure(const surface *scan, const vec3 *position, const double *spacing, size_t count,
                      threads *pool, double *farthest, error *e);

/* Uncovered places of a surface, each with its patch (0 without patches). */
typedef struct coverage_gaps {
    vec3 *place;
    uint32_t *patch;
    size_t count, place_capacity, patch_capacity;
} coverage_gaps;

/* Finds all places whose nearest point is farther than `limit` > 0, in spacings of that point.
 * Single-threaded. Free *out also after failure. Error: limit_memory. */
bool coverage_find_gaps(const surface *scan, const vec3 *position, const double *spacing, size_t count,
                        double limit, coverage_gaps *out, error *e);
void coverage_gaps_free(coverage_gaps *p); /* accepts a zeroed object */

#endif
