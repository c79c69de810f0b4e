// SPDX-License-Identifier: Apache-2.0
/* crossings: finds the cells that the surface crosses, before large arrays are allocated.
 *
 * A cell is the cube between voxels (i, j, k) and (i+1, j+1, k+1). It belongs to the block of its lowest
 * voxel. It is crossed if F has both signs at its corners; zero counts as outside. Blocks are in the order of
 * their coordinates, independently of the order in the file. Threads: those of a pool; results do not depend
 * on their number.
 */
#ifndef HEXAD_SURFACE_VOLUME_CROSSINGS_H
#define HEXAD_SURFACE_VOLUME_CROSSINGS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/volume/grid_view.h"

typedef struct crossing_block {
    int32_t block[3];
    uint8_t rows[64]; /* bit z of rows[8 x + y]: cell (x, y, z) is crossed */
    bool flat;        /* a cell has only zeros outside */
} crossing_block;

typedef struct crossings {
    crossing_block *blocks;
    size_t count, room;
    uint64_t cells;
    bool known_only;     /* cells with an unknown corner do not count, because the data end there */
    uint64_t open_cells; /* number of crossed cells with an unknown corner */
    int32_t open_at[3];  /* position of the first such cell */
} crossings;

/* Examines every block in which the sign of F may change. `memory_limit` bounds the memory of the search. */
bool crossings_find(const grid_view *l, size_t memory_limit, threads *pool, crossings *out, error *e);

/* A mask of the corners of a block's cells. Word x of part 0: the corners (x, y, z) with y, z < 8, bit 8 y +
 * z. Part 1: the corners with y = 8, bit z. Part 2: the corners with z = 8, bit 8 y. Part 3: the corner with
 * both, bit 0. Other bits are undefined. */
typedef struct corner_bits {
    uint64_t at[4][GRID_VIEW_SIDE + 1];
} corner_bits;

typedef struct corner_signs {
    corner_bits inside, outside, known; /* F < 0, F > 0 */
} corner_signs;

/* Adds a block if a cell is crossed. */
bool crossings_add(crossings *c, const int32_t block[3], const corner_signs *corners, error *e);

/* The number of crossed cells that have only zeros outside, with only zeros beyond them: the samples reach
 * the isovalue there without crossing it. */
uint64_t crossings_count_plateau(const grid_view *l, const crossings *c, threads *pool);

void crossings_free(crossings *c);

#endif
