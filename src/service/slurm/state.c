// SPDX-License-Identifier: Apache-2.0
#include "service/slurm/state.h"

#include <stddef.h>
#include <string.h>

#define WAITS(name)                                                   \
    {                                                                 \
        name, .waits = true, .words = "waiting in the queue of Slurm" \
    }
#define RUNS(name)               \
    {                            \
        name, .words = "it runs" \
    }
#define OVER(name, speaks, begun, not_begun, words)                          \
    {                                                                        \
        name, false, true, speaks, ENGINE_##begun, ENGINE_##not_begun, words \
    }

static const slurm_state states[] = {
    WAITS("PENDING"),
    WAITS("CONFIGURING"),
    WAITS("REQUEUED"),
    WAITS("REQUEUE_FED"),
    WAITS("REQUEUE_HOLD"),
    WAITS("RESV_DEL_HOLD"),
    WAITS("SPECIAL_EXIT"),
    RUNS("RUNNING"),
    RUNS("COMPLETING"),
    RUNS("STAGE_OUT"),
    RUNS("SIGNALING"),
    RUNS("STOPPED"),
    RUNS("SUSPENDED"),
    RUNS("RESIZING"),
    OVER("COMPLETED", false, INTERRUPTED, GIVEN_BACK, "the Slurm job ended without a record of the worker"),
    OVER("FAILED", false, INTERRUPTED, CRASHED, "the node could not run the attempt (Slurm: FAILED)"),
    OVER("CANCELLED", true, CRASHED, CRASHED, "the Slurm job was cancelled outside hexad"),
    OVER("PREEMPTED", true, GIVEN_BACK, GIVEN_BACK, "Slurm preempted the job (PREEMPTED)"),
    OVER("TIMEOUT", true, OUT_OF_TIME, GIVEN_BACK,
         "Slurm's time limit ended the worker (TIMEOUT): set limits.timeout_s, or ask for another partition"),
    OVER("DEADLINE", true, OUT_OF_TIME, OUT_OF_TIME, "the deadline of the Slurm job has passed (DEADLINE)"),
    OVER("OUT_OF_MEMORY", true, CRASHED, GIVEN_BACK,
         "the node's memory limit ended the worker (OUT_OF_MEMORY)"),
    OVER("NODE_FAIL", true, INTERRUPTED, INTERRUPTED, "the node failed (NODE_FAIL)"),
    OVER("BOOT_FAIL", true, INTERRUPTED, INTERRUPTED, "the node could not be booted (BOOT_FAIL)"),
    OVER("REVOKED", true, INTERRUPTED, INTERRUPTED, "another cluster has taken the Slurm job (REVOKED)"),
};

static const slurm_state unknown = RUNS("?");

const slurm_state slurm_state_gone =
    OVER("GONE", false, INTERRUPTED, GIVEN_BACK, "Slurm no longer lists the job");

const slurm_state *slurm_state_of(const char *name)
{
    for (size_t i = 0; i < sizeof states / sizeof *states; i++)
        if (strcmp(states[i].name, name) == 0) return &states[i];
    return &unknown;
}
