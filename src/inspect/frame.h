/* frame: where the samples of a volume lie in world space. */
#ifndef HEXAD_INSPECT_FRAME_H
#define HEXAD_INSPECT_FRAME_H

#include <stdint.h>

#include "json/json.h"

/* Adds `index_to_world` (row-major, column vectors), `voxel_size` (three lengths), `index_box` {min, max} and
 * `bounding_box` of the samples from `low` to `high`; without boxes where high is below low. */
void frame_describe(const double index_to_world[16], const int64_t low[3], const int64_t high[3], json *o);

#endif
