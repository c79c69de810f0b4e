/* cell_grid: a regular grid of cells over a box, and those of them that a surface crosses.
 *
 * For fields whose F can be asked for anywhere in the box at any time: formulas and splines. Crossing cells
 * are found by descending from large blocks, which a bound on F lets drop, to small ones, which are looked at
 * corner by corner, and between corners where a sharp edge may pass. World units. A grid belongs to one thread
 * until it is searched, to all afterwards.
 */
#ifndef HEXAD_FIELD_CELL_GRID_H
#define HEXAD_FIELD_CELL_GRID_H

#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "field/field.h"

/* Grids with more crossing cells than this are refused: 160 MB of indices. */
#define CELL_GRID_MOST ((size_t)20 << 20)

typedef struct cell_grid {
    bbox box;
    int64_t cells[3];  /* along each axis, > 0 */
    int64_t *crossing; /* linear indices of the crossing cells, by block; zeroed before the search */
    size_t count;
} cell_grid;

/* What the search asks of the field. */
typedef struct cell_grid_oracle {
    double (*value)(const field *f, vec3 x); /* F, or its side where it has no derivative */
    /* False only where F certainly has one sign in the box. */
    bool (*may_cross)(const field *f, vec3 low, vec3 high);
} cell_grid_oracle;

/* Fills in `crossing` and `count`; no crossing cell is no error. Errors: limit_memory (more than
 * CELL_GRID_MOST), cancelled (through the pool, which may be NULL). */
bool cell_grid_search(cell_grid *g, const field *f, const cell_grid_oracle *oracle, threads *pool, error *e);

/* Cells along each axis of a block; blocks begin at the lowest corner. */
#define CELL_GRID_BLOCK 8
static inline int64_t cell_grid_blocks(const cell_grid *g, int axis)
{
    return (g->cells[axis] + CELL_GRID_BLOCK - 1) / CELL_GRID_BLOCK;
}

/* As cell_grid_search, but looks only into blocks whose byte in `blocks` is not 0; `blocks` has a byte for each block of
 * the grid, x fastest. */
bool cell_grid_search_blocks(cell_grid *g, const field *f, const cell_grid_oracle *oracle,
                             const uint8_t *blocks, threads *pool, error *e);

/* Crossing cell number `index`, as field_ops wants it. */
void cell_grid_cell(const cell_grid *g, const field *f, const cell_grid_oracle *oracle, size_t index,
                    field_cell *out);

/* Which faces of the box the surface meets, as far as corners tell: bits as for field_set_boundary. */
unsigned cell_grid_cut_faces(const cell_grid *g, const field *f, const cell_grid_oracle *oracle);

size_t cell_grid_bytes(const cell_grid *g);
void cell_grid_free(cell_grid *g);

#endif
