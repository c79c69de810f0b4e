/* near_curves: rows along curves that come nearer to each other than points can lie are made one.
 *
 * A place of a row that is within NEAR_ROWS spacings of an earlier row, or of a corner, is left out (of a scan's within
 * NEAR_ROUGH_ROWS), and so is a corner within that distance of an earlier corner. The remaining places stand for its patches, too.
 * Rows of different patches are merged if the patches are connected by curves. Examples: the rims of a thin wall, two creases that meet
 * at an acute angle, a low step. On a scan a curve begins, ends and bends where no other place
 * is near. Rows on opposite walls, and rows of patches that are not connected, are not merged. World space.
 */
#ifndef HEXAD_SOLVER_NEAR_ROWS_H
#define HEXAD_SOLVER_NEAR_ROWS_H

#include "solver/curves/curve_samples.h"

/* Of a spacing. What is left out of an edge is cut off by as much at most, and by what the steps beside it cut: less than a third.
 * Rows of a scan follow bends that are no edges: they may be farther apart, for triangles between them are the narrower. */
#define NEAR_ROWS 0.30
#define NEAR_ROUGH_ROWS 0.35

typedef struct near_curves_input {
    size_t patch_count, curve_count;
    const bool *closed;
    uint32_t (*end)[2];    /* of each curve that is not closed: the places of its corners */
    const size_t *first;   /* curve_count + 1: the places of curve c are first[c] .. first[c + 1] */
    const double *spacing; /* of each place */
    const double *half;    /* of each stand, as they are before: its part of the border */
    bool rough;            /* corners at which no more than two curves end are none of the surface's */
} near_curves_input;

/* Changes places, stands and border of *rows in place. Error: limit_memory. Deterministic. */
bool near_curves_merge(const near_curves_input *in, curve_samples *rows, error *e);

#endif
