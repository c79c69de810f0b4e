/* regime: how a solve proceeds, and what else depends on that. The driver chooses one row of the table from the parameters. While it
 * solves it makes two transitions and no others: to `under_resolved` when the particles show that their spacing does not
 * resolve the surface, and to `with_longer_steps` when given points converge with too much energy. */
#ifndef HEXAD_SOLVER_REGIME_H
#define HEXAD_SOLVER_REGIME_H

#include <stdbool.h>

#include "solver/solver_params.h"
#include "solver/schedule.h"

typedef struct regime {
    const char *name; /* as in the report */
    const schedule *schedule;
    bool fast_kernel;  /* the kernel in single precision moves particles without a trial of the energy */
    bool is_continued; /* particles start at given positions and keep their order */
    bool
        is_under_resolved; /* pairs of opposite surfaces repel each other; steps that are left mean nothing */
    bool repairs_defects;  /* after convergence, where the parameters allow it */
    bool fills_gaps;       /* after projection over-dense particles go to uncovered places */
    bool goes_on_after_projection; /* until relocated particles have converged */
    bool
        spreads_points; /* in the end over-dense particles go to uncovered places, and nothing converges again */
    const struct regime *under_resolved, *with_longer_steps; /* transitions; NULL: there is none */
} regime;

const regime *regime_for(const solver_params *params);

#endif
