// SPDX-License-Identifier: Apache-2.0
/* curve_chains: the points along the feature curves of a solved surface, in the order of the curve. */
#ifndef HEXAD_SAMPLING_SOLVER_CURVES_CURVE_CHAINS_H
#define HEXAD_SAMPLING_SOLVER_CURVES_CURVE_CHAINS_H

#include "surface/field/patches.h"
#include "sampling/solver/solver.h"

/* Curve c has the points point[first[c]] .. point[first[c + 1] - 1], from its start to its end, including
 * corners. The first point of a closed curve is not repeated. A corner without a point is represented by the
 * point at the far end of its shortest curve. If samples of near curves were merged (merges_near_curves), a
 * chain lacks the samples that were merged into another curve's. */
typedef struct curve_chains {
    size_t *first;   /* per curve and one more */
    uint32_t *point; /* indices of points of the solve */
    size_t points;   /* points on curves */
    size_t corners;  /* points at corners */
} curve_chains;

void curve_chains_make(const field_patches *patches, const solver_points *solved, curve_chains *out);
void curve_chains_free(curve_chains *c); /* accepts a zeroed object */

/* Whether a step of length `step` skips samples that were merged into another curve's. `one`, `other`: the
 * spacings at its ends. */
bool curve_chains_jumps(const field_patches *patches, double step, double one, double other);

/* The steps along the chains as pairs of indices of patch points. Each step occurs once for each incident
 * patch. Steps that skip samples (curve_chains_jumps) are omitted. Free the result. */
uint32_t (*curve_chains_sides(const curve_chains *c, const field_patches *patches,
                              const solver_patch_points *patch_points, size_t *count))[2];

/* curve_chains_sides for the chains of a solved surface. */
uint32_t (*curve_chains_steps(const field_patches *patches, const solver_points *solved, size_t *count))[2];

/* Length of the polyline of a curve, closing segment included. World space. */
double curve_chains_length(const field_patches *patches, const field_curve *curve);

#endif
