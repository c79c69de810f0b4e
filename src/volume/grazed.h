/* grazed: cells that the surface passes though their corners are all on one side of it, and how much F bends in cells.
 *
 * A spline may cross an edge twice, or bulge through a face. Beginning with the cells that have corners on both sides, the
 * surface is followed through faces. A face is known not to be passed when its Bezier coefficients have one sign
 * (convex hull); else its sign is looked at in a lattice. Units: index space. Threads: those of a pool,
 * whose number does not show; incomplete where it was told to stop.
 */
#ifndef HEXAD_VOLUME_GRAZED_H
#define HEXAD_VOLUME_GRAZED_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/block_map.h"
#include "volume/crossed_cells.h"

struct bricks; /* volume/brick.h */

typedef struct grazed {
    crossed_cell *cell; /* that no corner tells */
    size_t count, room;
    uint8_t *passed;        /* 64 bytes a block: all cells, of either kind, with such a face */
    uint8_t *flat, *gentle; /* likewise: cells with corners on both sides, by their field_bend */
    bool joined;            /* all cells hang together, by faces that they share */
} grazed;

/* `size`: of the data where cells end with it, 0 along an axis where they do not. `aspect`: of a voxel the longest side over the
 * shortest, 1 or more.
 * `crossed`: 64 bytes a block, as rows of a crossing_block; receives the cells that are found. Error: limit_memory. Free
 * *out after failure, too. */
bool grazed_find(const struct bricks *b, const int64_t size[3], double aspect, threads *pool,
                 uint8_t *crossed, grazed *out, error *e);
void grazed_free(grazed *g);

#endif
