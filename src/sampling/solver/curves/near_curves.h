// SPDX-License-Identifier: Apache-2.0
/* near_curves: merges samples of feature curves that are closer to each other than the packing allows.
 *
 * A sample is removed if it lies within NEAR_CURVES spacings of a sample of an earlier curve or of a corner.
 * A corner is removed if it lies within that distance of an earlier corner. The sample that remains gets
 * copies for the patches of the removed one. Two samples of one curve are merged if they are that near,
 * because the curve folds back between them. This includes two consecutive samples.
 *
 * Samples are merged only if their patches are connected by curves: the rims of a thin wall, two edges that
 * meet at an acute angle, a low step. Samples of unconnected patches are not merged, nor samples on opposite
 * walls, whose normals differ by more than 114 degrees (RESOLUTION_OPPOSITE). The test compares the present
 * copies of two samples. Thus edges of opposite walls may be merged in a second pass: if a curve between them
 * was merged into both, both have copies on its patches.
 *
 * If the surface does not require this, only samples at the same place are merged, whatever their normals:
 * curves may touch where they have no common corner, as lines between labels do where a label is pinched.
 * World space.
 */
#ifndef HEXAD_SAMPLING_SOLVER_CURVES_NEAR_CURVES_H
#define HEXAD_SAMPLING_SOLVER_CURVES_NEAR_CURVES_H

#include "sampling/solver/curves/curve_samples.h"

/* Merge distance in spacings. Larger: longer parts of an edge are cut off. */
#define NEAR_CURVES 0.30
/* Merge distance for scanned meshes. Their feature curves follow smooth bends, so that a longer cut is
 * acceptable. */
#define NEAR_CURVES_OF_SCANS 0.35

typedef struct near_curves_input {
    size_t patch_count, curve_count;
    const bool *closed;
    uint32_t (*end)[2];    /* per open curve: the samples of its two corners */
    const size_t *first;   /* curve_count + 1: curve c has the samples first[c] .. first[c + 1] - 1 */
    const double *spacing; /* per sample */
    const double *half;    /* per copy before merging: its contribution to the border of its patch */
    /* The surface is a scanned mesh: NEAR_CURVES_OF_SCANS applies. A corner at which at most two curves end
     * is then the end of a curve and not a corner of the surface; it is merged into the nearest sample
     * within 0.65 spacings. */
    bool of_scan;
    bool coincident_only; /* merge only samples within 0.001 spacings of each other */
} near_curves_input;

/* Changes *samples in place. Error: limit_memory. Deterministic. */
bool near_curves_merge(const near_curves_input *in, curve_samples *samples, error *e);

#endif
