/* crossings: where the surface passes, found before anything large is allocated.
 *
 * A cell is the cube between voxels (i, j, k) and (i+1, j+1, k+1) and belongs to the block of its
 * lowest voxel; it is crossed when F has both signs among its corners, zero counting as outside.
 * Blocks come in the order of their coordinates, so that it does not matter how the file had them. Threads:
 * those of a pool, whose number does not show.
 */
#ifndef HEXAD_VOXELS_CROSSINGS_H
#define HEXAD_VOXELS_CROSSINGS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "voxels/grid_view.h"

typedef struct crossing_block {
    int32_t block[3];
    uint8_t rows[64]; /* bit z of rows[8 x + y]: cell (x, y, z) is crossed */
    bool flat;        /* one of them has nothing but zeros outside */
} crossing_block;

typedef struct crossings {
    crossing_block *blocks;
    size_t count, room;
    uint64_t cells;
    bool known_only;     /* cells with a corner that is not known do not count: the data end there */
    uint64_t open_cells; /* crossed cells with a corner that is not known */
    int32_t open_at[3];  /* the first of them */
} crossings;

/* Looks at every block where the sign of F may change. `memory_limit` bounds the search's own memory. */
bool crossings_find(const grid_view *l, size_t memory_limit, threads *pool, crossings *out, error *e);

/* A mask of the corners of a block's cells. Word x of part 0: the corners (x, y, z) with y, z < 8, bit 8 y + z; of
 * part 1 those with y = 8 in bits z; of part 2 those with z = 8 in bits 8 y; of part 3 the one with both in bit 0. Other
 * bits may be anything. */
typedef struct corner_bits {
    uint64_t at[4][GRID_VIEW_SIDE + 1];
} corner_bits;

typedef struct corner_signs {
    corner_bits inside, outside, known; /* F < 0, F > 0 */
} corner_signs;

/* Adds a block; nothing is added where no cell is crossed. */
bool crossings_add(crossings *c, const int32_t block[3], const corner_signs *corners, error *e);

/* How many crossed cells have nothing but zeros outside, and around them nothing but zeros beyond: the samples come to
 * the isovalue there and do not pass it. */
uint64_t crossings_count_plateau(const grid_view *l, const crossings *c, threads *pool);

void crossings_free(crossings *c);

#endif
