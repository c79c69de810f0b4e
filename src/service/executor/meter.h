// SPDX-License-Identifier: Apache-2.0
/* meter: counters of attempts, retries and ends since the daemon started, for /metrics. Any thread may read
 * and write.
 */
#ifndef HEXAD_SERVICE_EXECUTOR_METER_H
#define HEXAD_SERVICE_EXECUTOR_METER_H

#include "base/core/error.h"
#include "base/core/histogram.h"
#include "service/queue/queue.h"

/* How an attempt ended. */
#define METER_LIST(ENTRY, prefix)                 \
    ENTRY(prefix, CONVERGED, "converged")         \
    ENTRY(prefix, UNRESOLVED, "unresolved")       \
    ENTRY(prefix, NOT_CONVERGED, "not_converged") \
    ENTRY(prefix, FAILED, "failed")               \
    ENTRY(prefix, CANCELLED, "cancelled")         \
    ENTRY(prefix, TIMED_OUT, "timed_out")         \
    ENTRY(prefix, RETRIED, "retried") /* the task waits for another attempt */

typedef enum meter_outcome { METER_LIST(WORDS_ENUMERATOR, METER) METER_OUTCOME_COUNT } meter_outcome;

const char *meter_outcome_name(meter_outcome outcome);

typedef struct meter {
    atomic_uint_fast64_t attempts[METER_OUTCOME_COUNT][ERROR_CODE_COUNT]; /* ended attempts */
    histogram durations;                                                  /* of attempts with a worker */
    histogram waits; /* from the submission of a job to the first attempt of each of its tasks */
    atomic_uint_fast64_t cache_hits, cache_misses; /* of jobs that may get the result of an equal one */
} meter;

/* Records a claim of an attempt. */
void meter_note_claim(meter *m, const queue_claimed *claimed);

/* Records the end of an attempt. `state` is that of its task, QUEUE_QUEUED if another attempt follows;
 * `outcome` is that of a success; `ran_ms` is 0 if no worker ran. */
void meter_note_end(meter *m, queue_state state, queue_outcome outcome, error_code code, int64_t ran_ms);

#endif
