/* cell_grid: a regular grid of cells over a box, and those of them that a surface crosses.
 *
 * For fields whose F can be asked for anywhere in the box at any time: formulas, splines and combinations. Where a search
 * is told so, cells are divided: those of each level are half as long as those of the level before. Crossing cells
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
    int64_t cells[3];  /* along each axis, > 0, of level 0; twice as many of each next one */
    int finest;        /* the last level, < CELL_GRID_LEVELS; 0: all cells are of one size */
    int64_t *crossing; /* level and linear index of the crossing cells, by block; zeroed before the search */
    size_t count;
} cell_grid;

/* What the search asks of the field. */
typedef struct cell_grid_oracle {
    double (*value)(const field *f, vec3 x); /* F, or its side where it has no derivative */
    /* The same of VEC3_LANES places at once; may be NULL. */
    void (*values)(const field *f, const vec3_lanes *x, double value[VEC3_LANES]);
    /* False only where F certainly has one sign in the box. */
    bool (*may_cross)(const field *f, vec3 low, vec3 high);
} cell_grid_oracle;

/* Fills in `crossing` and `count`; no crossing cell is no error. The same with any number of threads; the pool may be NULL.
 * Errors: limit_memory (more than CELL_GRID_MOST, which some of the blocks tell before all are looked at; more blocks that the
 * surface may pass than an eighth of that; more than 2^31 cells along an axis, or 2^58 in all), not_supported (cells too small to
 * be told apart at their coordinates), cancelled. */
bool cell_grid_search(cell_grid *g, const field *f, const cell_grid_oracle *oracle, threads *pool, error *e);

/* Cells along each axis of a block, of any level; blocks begin at the lowest corner. */
#define CELL_GRID_BLOCK 8
#define CELL_GRID_LEVELS 16
static inline int64_t cell_grid_blocks(const cell_grid *g, int level, int axis)
{
    return ((g->cells[axis] << level) + CELL_GRID_BLOCK - 1) / CELL_GRID_BLOCK;
}

/* What is done with a block, bits: its cells are looked at; or, what comes first, its eight parts of the next level. */
enum { CELL_GRID_SEARCH = 1, CELL_GRID_DIVIDE = 2 };

/* As cell_grid_search, by what `blocks` says of the blocks of each level, x fastest. The field's cell size is that of the
 * last level. */
bool cell_grid_search_blocks(cell_grid *g, const field *f, const cell_grid_oracle *oracle,
                             const uint8_t *const blocks[CELL_GRID_LEVELS], threads *pool, error *e);

/* Crossing cell number `index`, as field_ops wants it. */
void cell_grid_cell(const cell_grid *g, const field *f, const cell_grid_oracle *oracle, size_t index,
                    field_cell *out);

/* Its middle, as field_ops wants it. */
vec3 cell_grid_middle(const cell_grid *g, size_t index, double *radius);

/* Which faces of the box the surface meets, as far as corners tell: bits as for field_set_boundary. */
unsigned cell_grid_cut_faces(const cell_grid *g, const field *f, const cell_grid_oracle *oracle);

size_t cell_grid_bytes(const cell_grid *g);
void cell_grid_free(cell_grid *g);

#endif
