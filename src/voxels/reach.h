/* reach: the blocks within a distance of the cells that the surface crosses.
 *
 * Distances are whole voxels from the corners of a crossed cell: the greatest along an axis, the straight one, or the sum
 * along the axes. A block is added if the distance of one of its voxels is within any of the
 * three limits; blocks of crossed cells always are.
 */
#ifndef HEXAD_VOXELS_REACH_H
#define HEXAD_VOXELS_REACH_H

#include <stdbool.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/block_map.h"
#include "voxels/crossings.h"

enum { REACH_MOST = 15 };

typedef struct reach_limits {
    int axis, straight, path; /* 0 .. REACH_MOST */
} reach_limits;

/* Adds the blocks to `map`, in the order of the crossed ones, whatever the pool's threads. Errors: limit_memory, cancelled. */
bool reach_add_blocks(const crossings *c, reach_limits limits, threads *pool, block_map *map, error *e);

#endif
