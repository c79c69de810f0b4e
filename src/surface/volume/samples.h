// SPDX-License-Identifier: Apache-2.0
/* samples: F at the voxels around the surface, block by block.
 *
 * This module reads them. prefilter.h converts them to coefficients of the interpolating spline, and
 * band_extension.h extrapolates a narrow band. Blocks, offsets and bits are those of grid_view.h. Threads:
 * those of a pool; results do not depend on their number. If the pool is stopped, the result is not complete.
 */
#ifndef HEXAD_SURFACE_VOLUME_SAMPLES_H
#define HEXAD_SURFACE_VOLUME_SAMPLES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/block_map.h"
#include "surface/volume/crossings.h"
#include "surface/volume/grid_view.h"

/* Memory of the voxels of several blocks, contiguous. */
typedef struct samples_store {
    float *f;
    size_t parts;     /* number of parts of SAMPLES_RELEASED blocks each; the last one may have fewer */
    int32_t *highest; /* for each part, the highest first coordinate of its blocks */
    size_t released;  /* number of parts, from the first, whose memory was freed */
} samples_store;

typedef struct samples {
    block_map map;                /* by number */
    float **f;                    /* 512 values per block */
    uint64_t *known, *inside;     /* 8 words per block: known voxels; voxels with F < 0 when they were read */
    uint32_t *near;               /* 6 indices per block: neighbours below and above along x, y, z */
    size_t spare;                 /* see samples_leaves */
    samples_store leaves, others; /* storage of f: blocks that were leaves of the grid, and other blocks */
} samples;

/* Number of blocks whose memory is released at a time: two megabytes. */
enum { SAMPLES_RELEASED = 1024 };

/* Memory, in bytes, of samples of `count` blocks, before and after samples_settle. */
size_t samples_bytes(size_t count, bool settled);

/* Bytes of voxels in leaves of a grid that are taken over: used by blocks of a map, and unused but kept with
 * them. Both are 0 if too few are used. */
typedef struct samples_leaves {
    size_t used, spare;
} samples_leaves;
samples_leaves samples_look(const grid_view *l, const block_map *map);

/* Takes over the map of the blocks to read and, if samples_look permits it, the voxels of the view's grid,
 * which then has none; both also on failure. Error: input_damaged (a value is not finite). */
bool samples_read(const grid_view *l, vdb_grid *grid, samples_leaves taken, block_map *map, threads *pool,
                  samples *out, error *e);
void samples_free(samples *s);

/* Frees data that are needed only while samples are made: known voxels, signs and neighbours. Windows can
 * still be read. */
void samples_settle(samples *s);

/* Reads the cube of side^3 voxels that begins at `low`, relative to the block's lowest voxel. The block must
 * exist, and the cube must lie within it and its neighbours. Voxels of missing neighbours are extrapolated
 * linearly from the nearest voxels of the block, but keep the sign of the nearest voxel. */
void samples_window(const samples *s, const int32_t block[3], const int low[3], int side, float *out);

/* Prefetches the block's voxels, before a window that contains them is read. */
void samples_fetch(const samples *s, const int32_t block[3]);

/* Releases the memory of voxels in blocks below `x` along the first axis, if it precedes the memory of all
 * other blocks. Their values are lost. */
void samples_release_below(samples *s, int32_t x);

/* F at the corners of the block's cells, 9^3: the samples, or with `smooth` the values of the spline
 * that has the samples as coefficients. */
void samples_corners(const samples *s, const int32_t block[3], bool smooth, float corners[729]);

/* The signs of samples_corners, and which of them are known. */
void samples_signs(const samples *s, const int32_t block[3], bool smooth, corner_signs *out);

#endif
