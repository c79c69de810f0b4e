// SPDX-License-Identifier: Apache-2.0
/* pair_measures: measures of points and the points near them: energies, close pairs, opposite walls, and the
 * cells that are certain (planar_cells.h), all from the same neighbour lists. Private to measures.c. */
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
    bool sized;       /* see measures_input */
    bool borders;     /* see planar_points */
    const bool *kept; /* see measures_input */
    const uint8_t
        *odd; /* of each point: its flags (point_flags.h); not 0 if it is not plain (planar_cells.h); NULL:
                         * all are plain */
} pair_measures_input;

/* Energies over that of a point in an ideal packing. */
typedef struct pair_energies {
    double plain; /* sum over the plain points */
    double *odd;  /* of each other point; owned by the caller, zeroed */
} pair_energies;

/* Sets `cells` and the areas of the certain ones (values for each point), or with NULL neither; and unless `out` is
 * NULL *energy, and of *out min_spacing_ratio, close_share, coincident, thin_count and thin_factor. Errors:
 * limit_memory, cancelled. Deterministic for any number of threads. */
bool pair_measures_take(const pair_measures_input *in, threads *pool, planar_cell *cells, double *area,
                        pair_energies *energy, measures *out, error *e);

/* For each point with a certain cell the mean of `value` over the point and its neighbours. Errors: as above. */
bool pair_measures_means(const pair_measures_input *in, const planar_cell *cells, const double *value,
                         threads *pool, double *mean, error *e);

#endif
