/* npz: NumPy's archives of arrays, one a property: position (count, 3), kappa (count,), ... The only user of the zip library (minizip). Reals are doubles, and whole numbers
 * int64. As format.h. */
#ifndef HEXAD_FORMATS_NPZ_H
#define HEXAD_FORMATS_NPZ_H

#include <stdbool.h>
#include <stdio.h>

#include "base/error.h"
#include "formats/points.h"

bool npz_write(FILE *file, const points *set, bool y_up, error *e);
bool npz_verify(FILE *file, const points *set, bool y_up, error *e);

#endif
