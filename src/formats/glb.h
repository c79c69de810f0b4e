/* glb: glTF 2.0 in one binary file: one primitive of POINTS with POSITION, NORMAL, COLOR_0 (in linear light), TEXCOORD_0, and
 * all others as _NAME. A node turns a set that stands along z, since glTF's y points up. The node of the points has the origin of the
 * scene as its translation. As format.h. */
#ifndef HEXAD_FORMATS_GLB_H
#define HEXAD_FORMATS_GLB_H

#include <stdbool.h>
#include <stdio.h>

#include "base/error.h"
#include "formats/points.h"
#include "formats/scene.h"

bool glb_write(FILE *file, const points *set, const scene *place, error *e);
bool glb_verify(FILE *file, const points *set, const scene *place, error *e);

#endif
