// SPDX-License-Identifier: Apache-2.0
/* settlement: decides on the task of an ended attempt, and applies the decision.
 *
 * The decision depends only on how the attempt ended and on its files. settlement_apply moves the result into
 * place and updates the queue, in an order that can be recovered after a crash at any point:
 *     the attempt's directory is renamed to results/ID and both parents are flushed,
 *     then the queue's transaction ends the task.
 * After a crash the task is still running in the queue. If results/ID is complete, only the second step is
 * missing. Only the supervisor thread calls these functions.
 */
#ifndef HEXAD_SERVICE_EXECUTOR_SETTLEMENT_H
#define HEXAD_SERVICE_EXECUTOR_SETTLEMENT_H

#include "service/executor/engine.h"
#include "service/executor/meter.h"
#include "service/queue/queue.h"

/* Why the supervisor stopped an attempt, if it did. */
typedef enum settlement_stop {
    SETTLEMENT_NOT_STOPPED,
    SETTLEMENT_CANCELLED,
    SETTLEMENT_TIMED_OUT,
    SETTLEMENT_STALLED,
    SETTLEMENT_DRAINED,
    SETTLEMENT_PAUSED, /* a pause was requested before the worker started */
    SETTLEMENT_MOVED   /* the priority of the job changed before the worker started */
} settlement_stop;

/* The decision on the task. */
typedef enum settlement_decision {
    /* the result cannot be read at the moment, for the reason in `message`; decide again later */
    SETTLEMENT_UNDECIDED,
    SETTLEMENT_SUCCEED, /* the attempt's directory is a result: it is delivered and the task has succeeded */
    SETTLEMENT_END,     /* the task ends without a result, in `state` */
    SETTLEMENT_RETRY,   /* queued again; the attempt does not count */
    /* queued again, because the daemon or the host ended during the attempt; the attempt does not count */
    SETTLEMENT_RETRY_INTERRUPTED,
    SETTLEMENT_RETRY_CRASHED, /* queued again after a wait; the attempt crashed or stalled, and counts */
    /* queued again after a wait, because a disk was full or failed; `code` and `message` have the cause. The
     * attempt does not count, but the number of such retries is limited. */
    SETTLEMENT_RETRY_STORAGE
} settlement_decision;

typedef struct settlement {
    settlement_decision decision;
    /* the task's final state, with SUCCEED, END, and RETRY_STORAGE when no retry is left */
    queue_state state;
    queue_outcome outcome; /* with SUCCEED */
    error_code code;       /* ERROR_NONE: no error */
    char message[sizeof((error *)0)->message];
    char reason[160];        /* for the attempt's record */
    int64_t ran_ms;          /* running time of the attempt; 0: unknown */
    bool in_place;           /* with SUCCEED: the result is already in results/ */
    bool keep;               /* with RETRY_STORAGE: the directory holds a result for the next attempt */
    const char *copied;      /* see queue_ending */
    bool copy_pending;       /* see queue_ending */
    error copy_fault;        /* with SUCCEED: why the result could not be copied to output.directory */
    const char *cached_from; /* with SUCCEED: the job that computed the result, or NULL */
    const char *cache_key, *cache_inputs; /* with SUCCEED; see queue_ending */
} settlement;

/* Parses the last line of a worker. False if it is not the JSON object of the contract (doc/worker.md). */
bool settlement_read_last_words(const char *words, error *said);

/* `limit_s` is the exceeded limit when `stop` is TIMED_OUT or STALLED. */
void settlement_decide(const queue_claimed *claimed, settlement_stop stop, double limit_s,
                       const engine_ending *ending, const char *directory, settlement *s);

/* Changes the decision on an attempt that failed while the state directory was lost: it is a fault of the
 * host, and the task is tried again. */
void settlement_excuse_loss(settlement *s);

/* Decides on a task whose worker could not be started. This is a fault of the service, so the attempt does
 * not count. */
void settlement_decide_unstarted(const error *why, settlement *s);

/* Decides on a task whose job requests more memory than this service has. */
void settlement_decide_too_large(const queue_claimed *claimed, int64_t memory_mb, settlement *s);

/* Decides on a task whose earlier attempts have used up its time limit. */
void settlement_decide_late(double limit_s, settlement *s);

/* Decides on a task whose directory contains a result with this outcome, which the job `from` computed. The
 * text must outlive the settlement. */
void settlement_decide_cached(queue_outcome outcome, const char *from, settlement *s);

/* Decides on a task whose directory contains the result of an earlier attempt that could not be copied to
 * output.directory. */
bool settlement_decide_kept(const char *directory, settlement *s, error *e);

/* Changes the decision because the result could not be copied to output.directory. If a disk was at fault,
 * the task is queued again, without its result if that is damaged. Otherwise the task succeeds, and the
 * queue stores why the result was not delivered. */
void settlement_decide_unpublished(const error *why, settlement *s);

/* Delay after a crashed attempt: `first_s` after the first one that counts, doubled after each further one,
 * up to `most_s`. */
typedef struct settlement_backoff {
    double first_s, most_s;
} settlement_backoff;

/* The queue, its directory, and the rules for further attempts. */
typedef struct settlement_place {
    queue *q;
    const char *work_dir;
    const char *host; /* for the attempts' records */
    meter *meter;
    settlement_backoff backoff;
    int storage_retries;   /* of a task, because a disk was full or failed */
    int max_interruptions; /* of a task; 0: any number */
} settlement_place;

/* Applies the decision, which must not be UNDECIDED. May be called again after a failure. `ending` is NULL if
 * no worker ran or its end is unknown. */
bool settlement_apply(const settlement_place *place, const queue_claimed *claimed, const settlement *s,
                      const engine_ending *ending, error *e);

/* Takes over a claim whose attempt still runs. False: it does not. */
typedef bool settlement_keep(void *keeper, const queue_claimed *claimed);

/* Settles the tasks that a crash left running in the queue, except those that keep(keeper, ...) takes over
 * (NULL: none). Such an attempt does not count, but too many of them end the task (error interrupted).
 * `restarted`: the host was restarted, too. */
bool settlement_recover(const settlement_place *place, bool restarted, settlement_keep *keep, void *keeper,
                        error *e);

#endif
