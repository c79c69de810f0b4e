// SPDX-License-Identifier: Apache-2.0
/* patch_report: reports the patches and curves of a surface. Pure function. */
#ifndef HEXAD_JOB_REPORT_PATCH_REPORT_H
#define HEXAD_JOB_REPORT_PATCH_REPORT_H

#include "surface/field/patches.h"
#include "base/json/json.h"
#include "surface/labels/label_surface.h"
#include "sampling/solver/solver.h"

/* Maximum number of listed patches, and of listed curves. Totals include all. */
enum { PATCH_REPORT_LISTED = 1000 };

/* Adds the members `patches` and `curves`. `farthest`: one value per patch, see coverage_measure. `h`:
 * spacing of the packing, world units. `labels`: for interfaces; otherwise NULL. */
void patch_report_put(const field_patches *patches, const solver_points *solved, const double *farthest,
                      double h, const label_surface *labels, json *report);

#endif
