// SPDX-License-Identifier: Apache-2.0
/* frame: the position of the samples of a volume in world space. */
#ifndef HEXAD_JOB_INSPECT_FRAME_H
#define HEXAD_JOB_INSPECT_FRAME_H

#include <stdint.h>

#include "base/json/json.h"

/* Adds `index_to_world` (row-major, for column vectors), `voxel_size` (three lengths), and for the samples
 * from `low` to `high` `index_box` {min, max} and `bounding_box`. Without the boxes if high < low. */
void frame_describe(const double index_to_world[16], const int64_t low[3], const int64_t high[3], json *o);

#endif
