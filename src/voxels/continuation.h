/* continuation: what a narrow band has beyond its clamp, as far as blocks are. Voxels that are not known get a value, and keep
 * their side of the surface. Threads: as in samples.h. */
#ifndef HEXAD_VOXELS_CONTINUATION_H
#define HEXAD_VOXELS_CONTINUATION_H

#include "voxels/samples.h"

/* Two layers of voxels, of which the first is known then: by a parabola or a line along each axis, averaged. Beyond, straight lines:
 * along each axis within a block, the one across the surface first, and from one block to the next, two blocks far. What no line
 * reaches stays. */
bool continuation_fill(samples *s, threads *pool, error *e);

#endif
