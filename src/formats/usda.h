/* usda: UsdGeomPoints as text: points, widths, normals, ids, velocities, extent, primvars:displayColor (in linear light),
 * primvars:st and all others as primvars. A set with triangles is a UsdGeomMesh. A frame of a sequence has its values as
 * samples at the time code of its number, and the stage of a sequence finds them there (value clips). As format.h. */
#ifndef HEXAD_FORMATS_USDA_H
#define HEXAD_FORMATS_USDA_H

#include <stdbool.h>
#include <stdio.h>

#include "base/error.h"
#include "formats/points.h"
#include "formats/scene.h"

bool usda_write(FILE *file, const points *set, const scene *place, error *e);
bool usda_verify(FILE *file, const points *set, const scene *place, error *e);

/* The stage of the sequence: what properties there are is that of this frame. */
bool usda_write_sequence(FILE *file, const points *set, const scene *place, error *e);
bool usda_verify_sequence(FILE *file, const points *set, const scene *place, error *e);

#endif
