/* dense_grid: the blocks of a dense volume near its isosurface, as a sparse grid.
 *
 * The slices are gone through twice, to find the blocks and to fill them, so that the whole is never in
 * memory. Beyond the data's end values are continued by reflection in its last sample (f(-k) = 2 f(0) - f(k),
 * axis after axis), which is how an interpolating spline with natural ends goes on; such voxels are inactive,
 * and cells with one are none of the surface's.
 */
#ifndef HEXAD_VOLUME_DENSE_GRID_H
#define HEXAD_VOLUME_DENSE_GRID_H

#include "dense/slices.h"
#include "vdb/vdb.h"

typedef struct dense_grid_facts {
    double lowest, highest;   /* of the finite values */
    uint64_t not_finite;      /* values that are not: NaN and -Inf count as the lowest, Inf as the highest */
    int64_t not_finite_at[3]; /* the first of them */
} dense_grid_facts;

/* A fog volume whose leaves reach two blocks around every cell crossed at the isovalue (above it is inside). Its values are those of
 * the file less the isovalue, which is subtracted before they become floats (vdb_grid.zero).
 * `memory_limit` bounds the grid and what is made of it. Errors: those of the slices; no_surface;
 * limit_memory. */
vdb_grid *dense_grid_make(slices *s, double isovalue, size_t memory_limit, dense_grid_facts *facts, error *e);

#endif
