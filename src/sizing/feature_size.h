/* feature_size: how thin the surface's parts are, and how narrow the gaps between its sheets.
 *
 * The feature size of a place is the radius of the smallest ball that touches the surface there and also touches, from
 * either side, a sheet that faces this one: whose normal makes an angle of more than 114 degrees with the place's. Its
 * centre is a place of the medial axis. For two parallel planes that is half their distance, for a tube its radius. A
 * convex edge is no feature, however sharp, as long as its faces meet at more than 66 degrees: the medial axis touches
 * the surface there, but a packing does not need to be finer to tell the faces apart. Nor is curvature by itself.
 *
 * The search goes from cubes of the surface's cells to ever larger ones, and ends with those that see a facing sheet:
 * on round shapes a tenth may be missing of the size, on flat ones nothing. Sizes below about a cell
 * are not told apart. Source: the medial ball that N. Amenta and M. Bern (1999) and M. Meyer, R. Kirby and R. Whitaker
 * (2007) use, restricted to facing sheets. World space and world units. */
#ifndef HEXAD_SIZING_FEATURE_SIZE_H
#define HEXAD_SIZING_FEATURE_SIZE_H

#include "base/error.h"
#include "base/threads.h"
#include "sizing/cell_samples.h"
#include "surface/surface.h"

/* Of each cell, at its sample: INFINITY where no sheet faces it, or where the sample was not found. Errors: limit_memory,
 * cancelled. Deterministic for any number of threads. */
bool feature_size_measure(const surface *scan, const cell_samples *sample, threads *pool, double *size,
                          error *e);

#endif
