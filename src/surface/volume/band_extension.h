// SPDX-License-Identifier: Apache-2.0
/* band_extension: extrapolates the values of a narrow band beyond its clamp, within the blocks of the
 * samples. Unknown voxels get a value with the sign of their side of the surface. Threads: as in samples.h.
 */
#ifndef HEXAD_SURFACE_VOLUME_BAND_EXTENSION_H
#define HEXAD_SURFACE_VOLUME_BAND_EXTENSION_H

#include "surface/volume/samples.h"

/* The first two layers of voxels get the mean, over the axes, of a parabola or a line through known voxels.
 * Beyond them the extrapolation is linear: along each axis within a block, the axis across the surface first,
 * and then from block to block for two blocks. A voxel that no line reaches is unchanged. Error:
 * limit_memory. If the pool is stopped, the result is not complete. */
bool band_extension_fill(samples *s, threads *pool, error *e);

#endif
