/* samples: F at the voxels around the surface, block by block.
 *
 * They are read here; prefilter.h makes them coefficients of the interpolating spline, and band_extension.h extrapolates a narrow
 * band. Blocks are those of grid_view.h.
 * Offsets, bits: see there. Threads: those of a pool; what comes out does not depend on
 * their number. If the pool is stopped, the result is not complete.
 */
#ifndef HEXAD_VOXELS_SAMPLES_H
#define HEXAD_VOXELS_SAMPLES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/block_map.h"
#include "voxels/crossings.h"
#include "voxels/grid_view.h"

/* Where voxels of several blocks lie, one after the other. */
typedef struct samples_store {
    float *f;
    size_t parts;     /* of SAMPLES_RELEASED blocks each, or less at the end */
    int32_t *highest; /* of each part, that its blocks have along the first axis */
    size_t released;  /* the number of parts, from the first, whose memory is freed */
} samples_store;

typedef struct samples {
    block_map map;            /* by number */
    float **f;                /* 512 a block */
    uint64_t *known, *inside; /* 8 words a block: voxels that are known; that had F < 0 when they were read */
    uint32_t *near;           /* 6 numbers a block: below and above along x, y, z */
    size_t spare;             /* see samples_leaves */
    samples_store leaves,
        others; /* storage of f: blocks that were leaves of the grid, and those that were not */
} samples;

/* Blocks whose memory is given back at once: two megabytes. */
enum { SAMPLES_RELEASED = 1024 };

/* Bytes that samples of `count` blocks take, and once they are settled. */
size_t samples_bytes(size_t count, bool settled);

/* Bytes of voxels in leaves of a grid that are taken over: those of use to blocks of a map, and those that stay beside
 * them. Both 0 where too few are of use. */
typedef struct samples_leaves {
    size_t used, spare;
} samples_leaves;
samples_leaves samples_look(const grid_view *l, const block_map *map);

/* Takes over the map of the blocks to read and, where samples_look says so, the voxels of the view's grid, which has none then;
 * both also when it fails. Values that are not finite are input_damaged. */
bool samples_read(const grid_view *l, vdb_grid *grid, samples_leaves taken, block_map *map, threads *pool,
                  samples *out, error *e);
void samples_free(samples *s);

/* Gives back what only making them takes: which voxels are known or were inside, and what lies beside a block. Windows remain. */
void samples_settle(samples *s);

/* The cube of side^3 voxels from `low` on, relative to the block's lowest voxel; the block must be there, and the cube
 * within it and its neighbours. Voxels of missing neighbours go on from the block's nearest. */
void samples_window(const samples *s, const int32_t block[3], const int low[3], int side, float *out);

/* Prefetches the block's voxels, before a window that contains them is read. */
void samples_fetch(const samples *s, const int32_t block[3]);

/* Gives back the memory of voxels in blocks below `x` along the first axis, where it comes before all others that are to
 * stay. What they held is lost. */
void samples_release_below(samples *s, int32_t x);

/* F at the corners of the block's cells, 9^3: the samples, or with `smooth` the values of the spline
 * that has the samples as coefficients. */
void samples_corners(const samples *s, const int32_t block[3], bool smooth, float corners[729]);

/* The signs of these, and which of them are known. */
void samples_signs(const samples *s, const int32_t block[3], bool smooth, corner_signs *out);

#endif
