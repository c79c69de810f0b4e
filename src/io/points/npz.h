// SPDX-License-Identifier: Apache-2.0
/* npz: NumPy archives with one array per property: position (count, 3), kappa (count,), ... Reals are
 * float64, whole numbers int64. The only user of minizip. Contracts: writers.h.
 */
#ifndef HEXAD_IO_POINTS_NPZ_H
#define HEXAD_IO_POINTS_NPZ_H

#include <stdbool.h>
#include <stdio.h>

#include "base/core/error.h"
#include "io/points/points.h"
#include "io/points/scene.h"

bool npz_write(FILE *file, const points *set, const scene *place, error *e);

#endif
