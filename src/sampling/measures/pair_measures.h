// SPDX-License-Identifier: Apache-2.0
/* pair_measures: measures of pairs of near points: energies, close pairs, opposite walls. Private to
 * measures.c. */
#ifndef HEXAD_SAMPLING_MEASURES_PAIR_MEASURES_H
#define HEXAD_SAMPLING_MEASURES_PAIR_MEASURES_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "sampling/measures/measures.h"
#include "sampling/measures/sites.h"

typedef struct pair_measures_input {
    const sites *sites;
    double h;
    bool sized;           /* see measures_input */
    const double *ideal;  /* the ideal degree of each point before rounding */
    const bool *at_wedge; /* per point: it has the flag PACKING_AT_WEDGE */
    const bool *kept;     /* see measures_input */
} pair_measures_input;

/* Sets energy_excess, min_spacing_ratio, close_share, coincident, thin_count and thin_factor. Errors:
 * limit_memory, cancelled. Deterministic. */
bool pair_measures_take(const pair_measures_input *in, threads *pool, measures *out, error *e);

#endif
