// SPDX-License-Identifier: Apache-2.0
/* hidden_crossing: finds cells that the surface crosses although their corners have one sign, and classifies
 * the curvature of F in cells.
 *
 * A spline may cross an edge twice, or bulge through a face. Starting at the cells with corners of both
 * signs, the surface is followed through faces. A face is not crossed if its Bezier coefficients have one
 * sign (convex hull property); otherwise its sign is evaluated on a lattice. Units: index space. Results do
 * not depend on the number of threads of the pool, and are incomplete if it was stopped.
 */
#ifndef HEXAD_SURFACE_VOLUME_HIDDEN_CROSSING_H
#define HEXAD_SURFACE_VOLUME_HIDDEN_CROSSING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/block_map.h"
#include "surface/volume/crossed_cells.h"

struct coefficient_blocks; /* surface/volume/coefficient_block.h */

typedef struct hidden_crossing {
    crossed_cell *cell; /* crossed cells whose corners have one sign */
    size_t count, capacity;
    uint8_t *passed; /* 64 bytes per block: all cells with a crossed face whose corners have one sign */
    uint8_t *flat, *gentle; /* likewise: cells with corners of both signs, by their field_bend */
    bool joined;            /* all cells are connected by shared faces */
} hidden_crossing;

/* `size`: of the data along axes on which cells end with the data; 0: they do not. `aspect` >= 1: longest
 * over shortest side of a voxel. `crossed`: 64 bytes per block, the rows of a crossing_block; receives the
 * cells that are found. Error: limit_memory. Free *out also after failure. */
bool hidden_crossing_find(const struct coefficient_blocks *b, const int64_t size[3], double aspect,
                          threads *pool, uint8_t *crossed, hidden_crossing *out, error *e);
void hidden_crossing_free(hidden_crossing *g);

#endif
