// SPDX-License-Identifier: Apache-2.0
/* pair_measures: measures of pairs of near points: energies, close pairs, opposite walls. Private to
 * measures.c. */
#ifndef HEXAD_SAMPLING_MEASURES_PAIR_MEASURES_H
#define HEXAD_SAMPLING_MEASURES_PAIR_MEASURES_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "sampling/measures/measures.h"
#include "sampling/measures/planar_cells.h"
#include "sampling/measures/sites.h"

typedef struct pair_measures_input {
    const sites *sites;
    double h;
    bool sized;           /* see measures_input */
    const bool *at_wedge; /* of each point: PACKING_AT_WEDGE */
    const bool *kept;     /* see measures_input */
    /* of each point: not 0 if it is not plain (planar_cells.h); NULL: all points are plain */
    const uint8_t *odd;
    bool pieces; /* the points are of several pieces */
} pair_measures_input;

/* Sets min_spacing_ratio, close_share, coincident, thin_count and thin_factor, and `energy` (a value for each
 * point): the energy of the point over that of a point in an ideal packing. With `out` NULL nothing of these
 * is computed. `cells` receives the certain cells; NULL: none are computed. Both use the same neighbour
 * lists. Errors: limit_memory, cancelled. Deterministic. */
bool pair_measures_take(const pair_measures_input *in, threads *pool, planar_cells *cells, float *energy,
                        measures *out, error *e);

#endif
