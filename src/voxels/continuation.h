/* continuation: what a narrow band has beyond its clamp, as far as blocks are. Threads: as in samples.h. */
#ifndef HEXAD_VOXELS_CONTINUATION_H
#define HEXAD_VOXELS_CONTINUATION_H

#include "voxels/samples.h"

/* Gives voxels that are not known the smooth continuation of those that are, samples or coefficients of the spline: the nearest a
 * parabola or a line along each axis, averaged; farther away a line along one axis, within a block; what no line reaches stays. Their
 * side of the surface stays what it was. */
bool continuation_fill(samples *s, threads *pool, error *e);

#endif
