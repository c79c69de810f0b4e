// SPDX-License-Identifier: Apache-2.0
/* slope: the slope of a grid's values at an isosurface: 1 for distances in world units. Pure functions. */
#ifndef HEXAD_SURFACE_VOLUME_SLOPE_H
#define HEXAD_SURFACE_VOLUME_SLOPE_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"
#include "io/vdb/vdb.h"

typedef struct slope {
    size_t count;             /* voxels used; 0: other members are not set */
    double low, median, high; /* quartiles of |grad|, per world unit */
} slope;

/* Measures the slope from differences between active neighbours on both sides of `value`. Error:
 * limit_memory. */
bool slope_measure(const vdb_grid *g, double value, const double to_index[3][4], slope *out, error *e);

/* *out: the isovalue of the surface at distance `offset` (world units) from that of `isovalue`. *unit: grid
 * units per world unit, 1 if that does not matter. Errors: input_unsupported (the values there are not
 * distances), limit_memory. */
bool slope_find_offset(const vdb_grid *g, double isovalue, double offset, const double to_index[3][4],
                       double *out, double *unit, error *e);

#endif
