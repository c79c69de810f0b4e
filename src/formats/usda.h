/* usda: UsdGeomPoints as text: points, widths, normals, ids, velocities, extent, primvars:displayColor (in linear light),
 * primvars:st and all others as primvars. A set with triangles is a UsdGeomMesh. As format.h. */
#ifndef HEXAD_FORMATS_USDA_H
#define HEXAD_FORMATS_USDA_H

#include <stdbool.h>
#include <stdio.h>

#include "base/error.h"
#include "formats/points.h"

bool usda_write(FILE *file, const points *set, bool y_up, error *e);
bool usda_verify(FILE *file, const points *set, bool y_up, error *e);

#endif
