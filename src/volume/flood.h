/* flood: whether the crossed cells of a volume hang together by their faces. Threads: none; no shared state. */
#ifndef HEXAD_VOLUME_FLOOD_H
#define HEXAD_VOLUME_FLOOD_H

#include <stdbool.h>
#include <stdint.h>

#include "base/error.h"
#include "geometry/block_map.h"

/* `crossed`: 64 bytes a block of the map, as rows of a crossing_block. *all: one can go from each cell to every other. Error:
 * limit_memory. */
bool flood_reaches_all(const block_map *map, const uint8_t *crossed, bool *all, error *e);

#endif
