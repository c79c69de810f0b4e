// SPDX-License-Identifier: Apache-2.0
#include "service/executor/meter.h"

const char *meter_outcome_name(meter_outcome outcome)
{
    static const char *const names[] = {METER_LIST(WORDS_TEXT, )};
    return names[outcome];
}

void meter_note_claim(meter *m, const queue_claimed *claimed)
{
    if (claimed->task.attempt == 1)
        histogram_add(&m->waits, claimed->task.started_ms - claimed->job.created_ms);
}

static meter_outcome find_outcome(queue_state state, queue_outcome outcome)
{
    switch (state) {
    case QUEUE_SUCCEEDED:
        return outcome == QUEUE_CONVERGED    ? METER_CONVERGED
               : outcome == QUEUE_UNRESOLVED ? METER_UNRESOLVED
                                             : METER_NOT_CONVERGED;
    case QUEUE_CANCELLED:
        return METER_CANCELLED;
    case QUEUE_TIMED_OUT:
        return METER_TIMED_OUT;
    case QUEUE_QUEUED:
        return METER_RETRIED;
    default:
        return METER_FAILED;
    }
}

void meter_note_end(meter *m, queue_state state, queue_outcome outcome, error_code code, int64_t ran_ms)
{
    if (ran_ms > 0) histogram_add(&m->durations, ran_ms);
    m->attempts[find_outcome(state, outcome)][code]++;
}
