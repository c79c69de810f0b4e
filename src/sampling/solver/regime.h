// SPDX-License-Identifier: Apache-2.0
/* regime: how a solve proceeds: its schedule, and which passes it makes. Regimes are constant; the driver
 * chooses one from the parameters. A solve changes its regime once in all or never: to `under_resolved` if
 * the spacing does not resolve the surface, or to `with_longer_steps` if given points converge with too much
 * energy. The regimes that it changes to have no transitions. See "Regimes" in doc/method.md. */
#ifndef HEXAD_SAMPLING_SOLVER_REGIME_H
#define HEXAD_SAMPLING_SOLVER_REGIME_H

#include <stdbool.h>

#include "sampling/solver/solver_params.h"
#include "sampling/solver/schedule.h"

typedef struct regime {
    const char *name; /* as in the report */
    const schedule *schedule;
    bool fast_kernel;       /* uses fast steps: single precision, without an energy test */
    bool is_continued;      /* particles start at given positions and keep their order */
    bool is_under_resolved; /* pairs on opposite walls repel each other; step_left is meaningless */
    bool repairs_defects;   /* after convergence, where may_repair_defects of driver.c permits it */
    /* after projection, relocates over-dense particles of patches to gaps in coverage */
    bool fills_gaps;
    bool goes_on_after_projection; /* sweeps again until relocated particles have converged */
    bool spreads_points; /* at the end, relocates over-dense particles to gaps; nothing converges again */
    const struct regime *under_resolved, *with_longer_steps; /* transitions; NULL: none */
} regime;

/* The initial regime of a solve. Static storage. */
const regime *regime_for(const solver_params *params);

#endif
