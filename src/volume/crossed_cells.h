/* crossed_cells: the cells that a volume's surface crosses, block by block, with F at their corners.
 *
 * A surface has millions. So a cell is a bit of its block, and F at a corner is kept once for all cells of the block that it
 * belongs to: some 14 bytes a cell instead of 44. Cells that are found later follow in a list.
 * Units: index space; F as in samples.h. Threads: those of a pool, whose number does not show; incomplete where it was told
 * to stop. Reading is safe in any number.
 */
#ifndef HEXAD_VOLUME_CROSSED_CELLS_H
#define HEXAD_VOLUME_CROSSED_CELLS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/block_map.h"
#include "voxels/crossings.h"
#include "voxels/samples.h"

typedef struct crossed_cell {
    int32_t at[3];
    uint32_t block; /* its block's number in the map */
    float value[8]; /* F at corner k as in field_cell */
} crossed_cell;

/* The cells of a block, and where F at their corners lies. Behind the last block is one without cells, which has the sums of all. */
typedef struct cell_block {
    uint32_t block;       /* its number in the map */
    uint16_t before[8];   /* cells of the block in layers below layer x */
    uint64_t layer[8];    /* bit 8 y + z of word x */
    size_t cells, values; /* of blocks before this one */
    int16_t row[81];      /* from `values` on: F at corner (x, y, 0), if it was there, in row[9 x + y] */
} cell_block;

typedef struct crossed_cells {
    const block_map *map; /* the caller's */
    cell_block *blocks;   /* block_count + 1 */
    size_t block_count;
    uint32_t *block_of; /* of each CROSSED_CELLS_STEP-th cell of a block: the number in `blocks` */
    float *value;
    crossed_cell *late;
    size_t count; /* of all cells */
} crossed_cells;

enum { CROSSED_CELLS_STEP = 32 };

/* Those of the crossings, whose blocks are in the map, without values. Errors: limit_memory, cancelled. */
bool crossed_cells_list(const crossings *c, const block_map *map, threads *pool, crossed_cells *out,
                        error *e);

/* Adds the values at their corners. `smooth`: as in samples_corners. Error: limit_memory. */
bool crossed_cells_take_values(crossed_cells *c, const samples *s, bool smooth, threads *pool, error *e);
void crossed_cells_free(crossed_cells *c);

/* Sets their bits in `rows`, 64 bytes for each block of the map, as crossing_block has them; before crossed_cells_add_late. */
void crossed_cells_mark(const crossed_cells *c, threads *pool, uint8_t *rows);

/* Takes over a list of cells, which may be freed. Once. */
void crossed_cells_add_late(crossed_cells *c, crossed_cell *late, size_t count);

void crossed_cells_get(const crossed_cells *c, size_t k, crossed_cell *out);

/* The block of cell k, which is none of the late ones; the next one tells where its cells end. */
const cell_block *crossed_cells_block(const crossed_cells *c, size_t k);

/* Its place alone. */
void crossed_cells_place(const crossed_cells *c, size_t k, int32_t at[3]);

/* How many come first, in the order of blocks: those that are not late. */
static inline size_t crossed_cells_in_blocks(const crossed_cells *c)
{
    return c->blocks[c->block_count].cells;
}

/* Bytes that it takes with values; of cells that were added late without the room that they do not use. */
size_t crossed_cells_bytes(const crossed_cells *c);

#endif
