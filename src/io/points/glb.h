// SPDX-License-Identifier: Apache-2.0
/* glb: binary glTF 2.0: one primitive of POINTS with POSITION, NORMAL, COLOR_0 (linear light), TEXCOORD_0,
 * and all other properties as _NAME. A node rotates a set with z up, since y points up in glTF. The node of
 * the points has the origin of the scene as its translation. Contracts: writers.h.
 */
#ifndef HEXAD_IO_POINTS_GLB_H
#define HEXAD_IO_POINTS_GLB_H

#include <stdbool.h>
#include <stdio.h>

#include "base/core/error.h"
#include "io/points/points.h"
#include "io/points/scene.h"

bool glb_write(FILE *file, const points *set, const scene *place, error *e);

#endif
