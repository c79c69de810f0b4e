/* slope: how steep a grid's values are where they pass a number: 1 where they are distances in world units.
 *
 * Threads: none; no shared state.
 */
#ifndef HEXAD_VOLUME_SLOPE_H
#define HEXAD_VOLUME_SLOPE_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"
#include "vdb/vdb.h"

typedef struct slope {
    size_t count;             /* voxels that were looked at; 0: nothing else is set */
    double low, median, high; /* quartiles of |grad|, per world unit */
} slope;

/* From differences between active neighbours of which one is below `value` and one is not. Errors: limit_memory. */
bool slope_measure(const vdb_grid *g, double value, const double to_index[3][4], slope *out, error *e);

/* The value on which the surface at distance `offset` from that of `isovalue` lies; *unit: how many of the grid's units
 * a world unit is, 1 where that makes no difference. Errors: input_unsupported for values that are no distances there;
 * limit_memory. */
bool slope_find_offset(const vdb_grid *g, double isovalue, double offset, const double to_index[3][4],
                       double *out, double *unit, error *e);

#endif
