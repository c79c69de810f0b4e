/* state: what the states of Slurm's jobs mean for an attempt. One table; any thread. */
#ifndef HEXAD_SLURM_STATE_H
#define HEXAD_SLURM_STATE_H

#include <stdbool.h>

#include "executor/engine.h"

typedef struct slurm_state {
    const char *name; /* as squeue prints it */
    bool waits;       /* it has not begun */
    bool over;        /* it will not run (any more) */
    bool speaks;      /* it gives the reason of a stop, which the worker does not have */
    /* with `over`: what becomes of an attempt that has no ending, when its worker has begun and when not */
    engine_loss begun, not_begun;
    const char *words;
} slurm_state;

/* A name that the table does not have is that of a job that is neither waiting nor over. Never NULL. */
const slurm_state *slurm_state_of(const char *name);

/* The state of a job that Slurm does not list, or no longer lists. */
extern const slurm_state slurm_state_gone;

#endif
