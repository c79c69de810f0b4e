// SPDX-License-Identifier: Apache-2.0
/* prefilter: converts samples to the coefficients of the interpolating cubic spline. Threads: as in
 * samples.h. */
#ifndef HEXAD_SURFACE_VOLUME_PREFILTER_H
#define HEXAD_SURFACE_VOLUME_PREFILTER_H

#include "surface/volume/samples.h"

/* Works in place, axis by axis, along runs of voxels in neighbouring blocks. For a narrow band (`known`) the
 * runs have the known voxels only. Each run is extrapolated beyond its ends as the parabola of its last three
 * voxels. Unknown voxels are unchanged and serve as coefficients beyond a known one. Otherwise the runs have
 * all voxels up to the last block. Source: Unser 1999, box 2, with other ends: the value to which the
 * recursion converges on the parabola. */
bool prefilter_run(samples *s, bool known, threads *pool, error *e);

#endif
