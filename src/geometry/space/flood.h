// SPDX-License-Identifier: Apache-2.0
/* flood: whether cells of 8^3 blocks are connected by their faces. Single-threaded; no shared state. */
#ifndef HEXAD_GEOMETRY_SPACE_FLOOD_H
#define HEXAD_GEOMETRY_SPACE_FLOOD_H

#include <stdbool.h>
#include <stdint.h>

#include "base/core/error.h"
#include "geometry/space/block_map.h"

/* `cells`: 64 bytes per block of the map; bit z of byte 8 x + y: the cell (x, y, z) is in the set. *all: the
 * set is connected by faces. Error: limit_memory. */
bool flood_reaches_all(const block_map *map, const uint8_t *cells, bool *all, error *e);

#endif
