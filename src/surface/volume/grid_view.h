// SPDX-License-Identifier: Apache-2.0
/* grid_view: reads the voxels of a loaded grid as values of F, in 8^3 blocks, at any position.
 *
 * F = value - isovalue for a level set and isovalue - value otherwise, so that F < 0 is inside. The value of
 * a level set's voxel is known if the voxel is active and not clamped to +-background; other voxels determine
 * only the sign. Every voxel of a fog volume is known: outside of the leaves it has the value of its tile or
 * the background. In a dense volume exactly the active voxels of the leaves are known. Voxel (x, y, z) of a
 * block has offset 64 x + 8 y + z and bit 8 y + z of word x, as in vdb.h. Units: index space; F in the unit
 * of the grid. Reading is safe with any number of threads.
 */
#ifndef HEXAD_SURFACE_VOLUME_GRID_VIEW_H
#define HEXAD_SURFACE_VOLUME_GRID_VIEW_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/block_map.h"
#include "io/vdb/vdb.h"

#define GRID_VIEW_SIDE 8
#define GRID_VIEW_VOXELS 512
#define GRID_VIEW_TILE_LEVELS 3

typedef enum grid_view_kind { GRID_VIEW_LEVEL_SET, GRID_VIEW_FOG, GRID_VIEW_DENSE } grid_view_kind;

/* Tiles of a level are 1 << shift blocks wide; their coordinates are those of their blocks >> shift. */
static const int grid_view_tile_shift[GRID_VIEW_TILE_LEVELS] = {0, 4, 9};

/* Masks of a leaf's voxels, in words as above: those with F < 0, with F > 0, and the known ones. */
typedef struct grid_view_signs {
    uint64_t inside[GRID_VIEW_SIDE], outside[GRID_VIEW_SIDE], known[GRID_VIEW_SIDE];
} grid_view_signs;

typedef struct grid_view {
    const vdb_grid *grid; /* owned by the caller; must outlive the view */
    double isovalue;
    grid_view_kind kind;
    bool plain;                     /* values need no conversion to F */
    float clamp_below, clamp_above; /* limits of active values that are clamped; or infinite */
    float background;               /* as F */
    block_map leaves;
    block_map tiles[GRID_VIEW_TILE_LEVELS];    /* by the coordinates of tiles */
    float *tile_values[GRID_VIEW_TILE_LEVELS]; /* as F */
    /* lowest, highest: range of the finite values of the grid, in its unit, including the background */
    float lowest, highest;
    uint64_t not_finite;    /* number of voxels in leaves */
    grid_view_signs *signs; /* of each leaf */
} grid_view;

/* A block that has one value everywhere, or a leaf. */
typedef struct grid_view_block {
    uint32_t leaf;  /* BLOCK_MAP_NONE: a constant block */
    float constant; /* F */
} grid_view_block;

/* Results do not depend on the pool, which may be NULL. Errors: limit_memory, input_damaged, cancelled. */
bool grid_view_init(grid_view *l, const vdb_grid *grid, grid_view_kind kind, double isovalue,
                    size_t memory_limit, threads *pool, error *e);
/* A table may take 1 / GRID_VIEW_TABLES of the limit: when it doubles, the old and the new one exist at the
 * same time. */
enum { GRID_VIEW_TABLES = 3 };
void grid_view_free(grid_view *l);

/* The voxel with the lowest coordinates, x before y before z, whose value is not finite; there must be
 * one. */
void grid_view_find_not_finite(const grid_view *l, int32_t at[3]);

grid_view_block grid_view_find(const grid_view *l, int32_t x, int32_t y, int32_t z);

/* A block and the 26 around it, in the order of block_map_around. */
void grid_view_around(const grid_view *l, const int32_t block[3], grid_view_block out[27]);

/* F of all 512 voxels; `f` may be the leaf's own values. */
void grid_view_read(const grid_view *l, grid_view_block b, float f[GRID_VIEW_VOXELS]);

/* Returns the signs of a block. For a constant block they are written to *constant, which is returned. */
const grid_view_signs *grid_view_find_signs(const grid_view *l, grid_view_block b, grid_view_signs *constant);

#endif
