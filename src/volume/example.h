/* example: a small level set that the project makes itself, so that a fresh clone has something to
 * sample: a tube along a trefoil knot, about 2.5 units across. */
#ifndef HEXAD_VOLUME_EXAMPLE_H
#define HEXAD_VOLUME_EXAMPLE_H

#include <stdbool.h>

#include "base/error.h"

#define EXAMPLE_GRID "trefoil"
#define EXAMPLE_TUBE_RADIUS 0.15
#define EXAMPLE_VOXEL 0.02

/* Writes an OpenVDB file with one half-stored level set of about 140 000 active voxels (some 300 kB)
 * at the descriptor's offset. Errors: limit_memory; internal when writing fails. */
bool example_write(int fd, error *e);

#endif
