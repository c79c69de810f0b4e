// SPDX-License-Identifier: Apache-2.0
/* vtp: VTK PolyData as XML, each point a vertex, with one array per property: float64 or int64, appended as
 * raw bytes. Contracts: writers.h.
 */
#ifndef HEXAD_IO_POINTS_VTP_H
#define HEXAD_IO_POINTS_VTP_H

#include <stdbool.h>
#include <stdio.h>

#include "base/core/error.h"
#include "io/points/points.h"
#include "io/points/scene.h"

bool vtp_write(FILE *file, const points *set, const scene *place, error *e);

#endif
