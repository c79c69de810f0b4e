// SPDX-License-Identifier: Apache-2.0
/* example: a small generated level set for first tests: a tube along a trefoil knot, about 2.5 units
 * across. */
#ifndef HEXAD_SURFACE_VOLUME_EXAMPLE_H
#define HEXAD_SURFACE_VOLUME_EXAMPLE_H

#include <stdbool.h>

#include "base/core/error.h"

#define EXAMPLE_GRID "trefoil"
#define EXAMPLE_TUBE_RADIUS 0.15
#define EXAMPLE_VOXEL 0.02

/* Writes an OpenVDB file with one level set in half floats, of about 140 000 active voxels (300 kB), at the
 * descriptor's offset. Errors: limit_memory, internal (writing failed). */
bool example_write(int fd, error *e);

#endif
