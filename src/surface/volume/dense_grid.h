// SPDX-License-Identifier: Apache-2.0
/* dense_grid: converts the blocks of a dense volume near its isosurface to a sparse grid.
 *
 * Two passes over the slices find the blocks and fill them, so that the whole volume is never in memory.
 * Beyond the end of the data, values are extrapolated by point reflection at the last sample (f(-k) = 2
 * f(0) - f(k), axis by axis), as an interpolating spline with natural ends. Such voxels are inactive, and
 * cells with such voxels do not belong to the surface.
 */
#ifndef HEXAD_SURFACE_VOLUME_DENSE_GRID_H
#define HEXAD_SURFACE_VOLUME_DENSE_GRID_H

#include "base/core/threads.h"
#include "io/volumes/slices.h"
#include "io/vdb/vdb.h"
#include "surface/volume/thin_walls.h"

/* Sums of floats of larger values could overflow. */
#define DENSE_GRID_LARGEST 1e30

typedef struct dense_grid_facts {
    double lowest, highest; /* range of the usable values */
    /* Number of values that are not usable: NaN, infinite, or beyond DENSE_GRID_LARGEST, which programs write where there
     * are no data. NaN and negative ones count as `lowest`, positive ones as `highest`. */
    uint64_t unusable;
    int64_t unusable_at[3]; /* index of the first one */
    uint64_t missing;       /* number of values that are no_data; they count as `lowest` */
    thin_walls_found walls; /* owned by the caller, also after failure */
} dense_grid_facts;

/* Makes a fog volume whose leaves extend two blocks around every cell crossed at the isovalue (above it is
 * inside). Its values are those of the file minus the isovalue, subtracted before the conversion to floats
 * (vdb_grid.zero). `memory_limit` bounds the grid and what is made from it, bytes. The caller frees the grid.
 * `no_data`: a value that means that there are no data; NAN: none. Errors: those of the slices, no_surface, limit_memory,
 * input_damaged (unusable values that count as `highest` make more than a hundredth of the surface); cancelled, if the
 * pool is stopped. */
vdb_grid *dense_grid_make(slices *s, double isovalue, double no_data, size_t memory_limit, threads *pool,
                          dense_grid_facts *facts, error *e);

#endif
