/* patch_report: what the report tells of the patches and curves of a surface. Pure function. */
#ifndef HEXAD_RUN_PATCH_REPORT_H
#define HEXAD_RUN_PATCH_REPORT_H

#include "field/patches.h"
#include "json/json.h"
#include "labels/label_surface.h"
#include "solver/solver.h"

/* Most that are told one by one, of patches and of curves; the others count in the totals. */
enum { PATCH_REPORT_LISTED = 1000 };

/* Adds the members `patches` and `curves`. `farthest`: of each patch, see coverage_measure; `h`: the spacing of the packing.
 * `labels`: of interfaces; else NULL. */
void patch_report_put(const field_patches *patches, const solver_points *solved, const double *farthest,
                      double h, const label_surface *labels, json *report);

#endif
