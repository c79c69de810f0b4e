/* near_curves: merges samples of feature curves that are nearer to each other than points can lie.
 *
 * A sample within NEAR_CURVES spacings of a sample of an earlier curve, or of a corner, is removed (of a scan's within
 * NEAR_CURVES_OF_SCANS), and so is a corner within that distance of an earlier corner. The sample that remains gets copies for the patches of
 * the removed one. Samples of different patches are merged if the patches are connected by curves: the rims of a thin wall, two
 * edges that meet at an acute angle, a low step. Samples on opposite walls, and of patches that are not connected, are not merged.
 * World space.
 */
#ifndef HEXAD_SOLVER_NEAR_CURVES_H
#define HEXAD_SOLVER_NEAR_CURVES_H

#include "solver/curves/curve_samples.h"

/* Distances of merging, over the spacing. A larger one cuts off more of an edge. Feature curves of a scan follow bends that are no
 * edges, so that more may be cut off. */
#define NEAR_CURVES 0.30
#define NEAR_CURVES_OF_SCANS 0.35

typedef struct near_curves_input {
    size_t patch_count, curve_count;
    const bool *closed;
    uint32_t (*end)[2];    /* of each curve that is not closed: the samples of its corners */
    const size_t *first;   /* curve_count + 1: curve c has the samples from first[c] up to first[c + 1] */
    const double *spacing; /* of each sample */
    const double *half;    /* of each copy before merging: its part of the border */
    bool of_scan;          /* corners at which at most two curves end are no corners of the surface */
} near_curves_input;

/* Changes *samples in place. Error: limit_memory. Deterministic. */
bool near_curves_merge(const near_curves_input *in, curve_samples *samples, error *e);

#endif
