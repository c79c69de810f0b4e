/* npz: NumPy's archives of arrays, one a property: position (count, 3), kappa (count,), ... The only user of the zip library (minizip). Reals are doubles, and whole numbers
 * int64. As format.h. */
#ifndef HEXAD_FORMATS_NPZ_H
#define HEXAD_FORMATS_NPZ_H

#include <stdbool.h>
#include <stdio.h>

#include "base/error.h"
#include "formats/points.h"
#include "formats/scene.h"

bool npz_write(FILE *file, const points *set, const scene *place, error *e);
bool npz_verify(FILE *file, const points *set, const scene *place, error *e);

#endif
