// SPDX-License-Identifier: Apache-2.0
/* state: the meaning of Slurm's job states for an attempt. Constant data; any thread. */
#ifndef HEXAD_SERVICE_SLURM_STATE_H
#define HEXAD_SERVICE_SLURM_STATE_H

#include <stdbool.h>

#include "service/executor/engine.h"

typedef struct slurm_state {
    const char *name; /* as squeue prints it */
    bool waits;       /* it has not begun */
    bool over;        /* it does not run and will not run again */
    bool speaks;      /* it states the reason of a stop, which the worker cannot report */
    /* with `over`: the loss of an attempt without an ending, if its worker has begun, and if not */
    engine_loss begun, not_begun;
    const char *words;
} slurm_state;

/* The state of this name. An unknown name is treated as a running job. Never NULL. */
const slurm_state *slurm_state_of(const char *name);

/* The state of a job that Slurm does not list. */
extern const slurm_state slurm_state_gone;

#endif
