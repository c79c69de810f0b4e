// SPDX-License-Identifier: Apache-2.0
/* feature_size: the thickness of the surface's parts and the width of its gaps.
 *
 * The feature size at a place is the radius of the smallest ball, on either side, that touches the surface
 * there and an opposite wall: a place whose normal makes an angle of more than 114 degrees with that of the
 * place. The centre of the ball is on the medial axis. For two parallel planes the feature size is half of
 * their distance, for a tube its radius. Sharp convex edges are not features if their faces meet at more than
 * 66 degrees: the medial axis touches the surface there, but a packing does not need to be finer to separate
 * the faces. Curvature alone is not a feature.
 *
 * The search starts with cubes of the size of the surface's cells and continues with larger ones, until an
 * opposite wall is found. On round shapes sizes may be too small by a tenth; on flat ones they are exact.
 * Sizes below about a cell are not distinguished. Source: the medial ball of N. Amenta and M. Bern (1999) and
 * M. Meyer, R. Kirby and R. Whitaker (2007), restricted to opposite walls. World space and world units.
 */
#ifndef HEXAD_SAMPLING_SIZING_FEATURE_SIZE_H
#define HEXAD_SAMPLING_SIZING_FEATURE_SIZE_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "sampling/sizing/cell_samples.h"
#include "surface/scan/surface.h"

/* Measures the feature size at the sample of each cell: INFINITY if there is no opposite wall, or if the
 * sample was not found. Errors: limit_memory, cancelled. Deterministic for any number of threads. */
bool feature_size_measure(const surface *scan, const cell_samples *sample, threads *pool, double *size,
                          error *e);

#endif
