// SPDX-License-Identifier: Apache-2.0
/* reach: finds the blocks within a distance of the cells that the surface crosses.
 *
 * Distances are whole voxels from the corners of a crossed cell: the maximum norm, the Euclidean norm, or the
 * sum over the axes. A block is added if the distance of one of its voxels is within any of the three limits.
 * Blocks of crossed cells are always added.
 */
#ifndef HEXAD_SURFACE_VOLUME_REACH_H
#define HEXAD_SURFACE_VOLUME_REACH_H

#include <stdbool.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/block_map.h"
#include "surface/volume/crossings.h"

enum { REACH_MOST = 15 };

typedef struct reach_limits {
    int axis, straight, path; /* maximum norm, Euclidean norm, sum; 0 .. REACH_MOST */
} reach_limits;

/* Adds the blocks to `map`, in the order of the crossed ones, independently of the pool's threads. Errors:
 * limit_memory, cancelled. */
bool reach_add_blocks(const crossings *c, reach_limits limits, threads *pool, block_map *map, error *e);

#endif
