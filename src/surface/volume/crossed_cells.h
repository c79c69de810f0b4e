// SPDX-License-Identifier: Apache-2.0
/* crossed_cells: the cells that the surface of a volume crosses, block by block, with F at their corners.
 *
 * There may be millions. A cell is a bit of its block, and F at a corner is stored once for all cells of the
 * block that share it: about 14 bytes per cell instead of 44. Cells that are added later are in a list.
 * Units: index space; F as in samples.h. Results do not depend on the number of threads of the pool, and are
 * incomplete if it was stopped. Reading: any thread.
 */
#ifndef HEXAD_SURFACE_VOLUME_CROSSED_CELLS_H
#define HEXAD_SURFACE_VOLUME_CROSSED_CELLS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/block_map.h"
#include "surface/volume/crossings.h"
#include "surface/volume/samples.h"

typedef struct crossed_cell {
    int32_t at[3];
    uint32_t block; /* index of its block in the map */
    float value[8]; /* F at corner k as in field_cell */
} crossed_cell;

/* The cells of a block, and the positions of F at their corners. The last element has no cells: it has the
 * totals. */
typedef struct cell_block {
    uint32_t block;       /* index in the map */
    uint16_t before[8];   /* number of cells of the block in layers below x */
    uint64_t layer[8];    /* bit 8 y + z of word x is cell (x, y, z) */
    size_t cells, values; /* totals of the blocks before this one */
    /* index, relative to `values`, at which F at corner (x, y, 0) is or would be: row[9 x + y] */
    int16_t row[81];
} cell_block;

typedef struct crossed_cells {
    const block_map *map; /* owned by the caller */
    cell_block *blocks;   /* block_count + 1 elements */
    size_t block_count;
    uint32_t *block_of; /* for every CROSSED_CELLS_STEP-th cell: its index in `blocks` */
    float *value;
    crossed_cell *late;
    size_t count; /* all cells, late ones included */
} crossed_cells;

enum { CROSSED_CELLS_STEP = 32 };

/* Lists the cells of the crossings, whose blocks are in the map, without values. Errors: limit_memory,
 * cancelled. */
bool crossed_cells_list(const crossings *c, const block_map *map, threads *pool, crossed_cells *out,
                        error *e);

/* Sets F at the corners. `smooth`: as in samples_corners. Error: limit_memory. */
bool crossed_cells_take_values(crossed_cells *c, const samples *s, bool smooth, threads *pool, error *e);
void crossed_cells_free(crossed_cells *c);

/* Sets the bits of the cells in `rows`, 64 bytes for each block of the map, as in crossing_block. Call it
 * before crossed_cells_add_late. */
void crossed_cells_mark(const crossed_cells *c, threads *pool, uint8_t *rows);

/* Takes ownership of a list of cells, allocated by malloc. Call it at most once. */
void crossed_cells_add_late(crossed_cells *c, crossed_cell *late, size_t count);

void crossed_cells_get(const crossed_cells *c, size_t k, crossed_cell *out);

/* The block of cell k, which is not a late cell; the next element has the end of its cells. */
const cell_block *crossed_cells_block(const crossed_cells *c, size_t k);

/* The position of cell k. */
void crossed_cells_place(const crossed_cells *c, size_t k, int32_t at[3]);

/* The number of cells that are not late; they come first, in the order of blocks. */
static inline size_t crossed_cells_in_blocks(const crossed_cells *c)
{
    return c->blocks[c->block_count].cells;
}

/* Bytes with values; unused capacity of the list of late cells does not count. */
size_t crossed_cells_bytes(const crossed_cells *c);

#endif
