// SPDX-License-Identifier: Apache-2.0
/* usda: UsdGeomPoints as text: points, widths, normals, ids, velocities, extent, primvars:displayColor
 * (linear light), primvars:st and all other properties as primvars. With scene.instancer, points are a
 * UsdGeomPointInstancer. A set with triangles is a UsdGeomMesh. A frame of a sequence has time samples at the
 * time code of its number; the stage of a sequence refers to them by value clips. Contracts: writers.h.
 */
#ifndef HEXAD_IO_POINTS_USDA_H
#define HEXAD_IO_POINTS_USDA_H

#include <stdbool.h>
#include <stdio.h>

#include "base/core/error.h"
#include "io/points/points.h"
#include "io/points/scene.h"

bool usda_write(FILE *file, const points *set, const scene *place, error *e);

/* The stage of the sequence, with the properties of this frame. */
bool usda_write_sequence(FILE *file, const points *set, const scene *place, error *e);

/* usda_write_sequence for the folder that contains the folders of all frames. */
bool usda_write_stage(FILE *file, const points *set, const scene *place, error *e);

#endif
