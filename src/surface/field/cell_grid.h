// SPDX-License-Identifier: Apache-2.0
/* cell_grid: a regular grid of cells over a box, and the list of its cells that a surface crosses.
 *
 * For fields whose F is defined everywhere in the box: formulas, splines and combinations. Cells can be
 * subdivided: the cells of each level have half the edge length of the level before. The search descends from
 * large blocks, which are discarded where a bound shows that F has one sign, to small ones, in which F is
 * evaluated at every corner and, where a sharp edge may pass, between corners. World units. A grid belongs to
 * one thread until it is searched; then any thread may read it.
 */
#ifndef HEXAD_SURFACE_FIELD_CELL_GRID_H
#define HEXAD_SURFACE_FIELD_CELL_GRID_H

#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/field/field.h"

/* Maximum number of crossing cells: 160 MB of indices. */
#define CELL_GRID_MOST ((size_t)20 << 20)

typedef struct cell_grid {
    bbox box;
    /* cells along each axis at level 0, > 0; each level has twice as many as the one before */
    int64_t cells[3];
    int finest; /* last level, < CELL_GRID_LEVELS; 0: all cells have one size */
    /* level and linear index of the crossing cells, sorted by block; NULL before the search */
    int64_t *crossing;
    size_t count;
} cell_grid;

/* The functions of the field that the search calls. */
typedef struct cell_grid_oracle {
    double (*value)(const field *f, vec3 x); /* F, or a value of the right sign where F has no derivative */
    /* `value` at VEC3_LANES places at once; may be NULL */
    void (*values)(const field *f, const vec3_lanes *x, double value[VEC3_LANES]);
    /* False only if F is known to have one sign in the box */
    bool (*may_cross)(const field *f, vec3 low, vec3 high);
} cell_grid_oracle;

/* Sets `crossing` and `count`; `count` 0 is not an error. The result does not depend on the number of
 * threads;
 * the pool may be NULL. Errors: limit_memory (more than CELL_GRID_MOST crossing cells, which may be estimated
 * from a sample of the blocks; more than CELL_GRID_MOST / 8 blocks; more than 2^31 cells along an axis or
 * 2^58 in total), not_supported (cells too small for the precision of their coordinates), cancelled. */
bool cell_grid_search(cell_grid *g, const field *f, const cell_grid_oracle *oracle, threads *pool, error *e);

/* Cells along each axis of a block, at any level. Blocks start at the lowest corner of the grid. */
#define CELL_GRID_BLOCK 8
#define CELL_GRID_LEVELS 16
static inline int64_t cell_grid_blocks(const cell_grid *g, int level, int axis)
{
    return ((g->cells[axis] << level) + CELL_GRID_BLOCK - 1) / CELL_GRID_BLOCK;
}

/* Bits of a block. DIVIDE comes first: the eight blocks of the next level are processed instead. SEARCH: the
 * cells of the block are tested. */
enum { CELL_GRID_SEARCH = 1, CELL_GRID_DIVIDE = 2 };

/* cell_grid_search in marked blocks: `blocks` has the bits of the blocks of each level, x fastest. The cell
 * size of the field is that of the last level. */
bool cell_grid_search_blocks(cell_grid *g, const field *f, const cell_grid_oracle *oracle,
                             const uint8_t *const blocks[CELL_GRID_LEVELS], threads *pool, error *e);

/* Implements `cell` of field_ops for crossing cell `index`. */
void cell_grid_cell(const cell_grid *g, const field *f, const cell_grid_oracle *oracle, size_t index,
                    field_cell *out);

/* Implements `cell_middle` of field_ops. */
vec3 cell_grid_middle(const cell_grid *g, size_t index, double *radius);

/* The faces of the box that the surface crosses, from the signs at corners: bits as in field_set_boundary. */
unsigned cell_grid_cut_faces(const cell_grid *g, const field *f, const cell_grid_oracle *oracle);

size_t cell_grid_bytes(const cell_grid *g);
void cell_grid_free(cell_grid *g);

#endif
