/* prefilter: from samples to coefficients of the cubic spline that has their values. Threads: as in samples.h. */
#ifndef HEXAD_VOXELS_PREFILTER_H
#define HEXAD_VOXELS_PREFILTER_H

#include "voxels/samples.h"

/* In place, axis by axis, along runs of voxels in neighbouring blocks. For a narrow band (`known`) these are the known
 * voxels only: each run goes on beyond its ends as the parabola of its last three voxels does, and voxels that are not
 * known stay as they are: beyond a known one they do instead of coefficients. Else all voxels count, to the last block.
 * Source: Unser 1999, box 2, with other ends: what the recursion would have come to on the parabola. */
bool prefilter_run(samples *s, bool known, threads *pool, error *e);

#endif
