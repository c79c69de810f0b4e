/* settlement: what becomes of a job whose attempt has ended.
 *
 * Deciding looks only at how the attempt ended and what it left; applying moves the result into
 * place and tells the queue, in an order that a crash at any point leaves recoverable:
 *     the attempt's directory is renamed to results/ID and both parents are flushed,
 *     then the queue's transaction ends the job.
 * A start after a crash finds a job still running by the book and, if results/ID is whole, only the
 * second step missing. Called by the supervisor thread alone.
 */
#ifndef HEXAD_EXECUTOR_SETTLEMENT_H
#define HEXAD_EXECUTOR_SETTLEMENT_H

#include "executor/engine.h"
#include "queue/queue.h"

/* Why the supervisor stopped an attempt, if it did. */
typedef enum settlement_stop {
    SETTLEMENT_NOT_STOPPED,
    SETTLEMENT_CANCELLED,
    SETTLEMENT_TIMED_OUT,
    SETTLEMENT_STALLED,
    SETTLEMENT_DRAINED
} settlement_stop;

typedef struct settlement {
    bool undecided;       /* the result cannot be looked at just now (message): decide again later */
    bool deliver;         /* the directory is a result */
    bool requeue, counts; /* back into the queue; whether the attempt counts */
    queue_state state;    /* otherwise: the job's end */
    queue_outcome outcome;
    error_code code; /* ERROR_NONE: no error */
    char message[sizeof((error *)0)->message];
    char reason[160]; /* for the attempt's record */
} settlement;

/* `limit_s` is the limit that was hit when `stop` says that one was. */
void settlement_decide(const queue_job *job, settlement_stop stop, double limit_s,
                       const engine_ending *ending, const char *directory, settlement *s);

/* For an attempt that did not start: a fault of the service, not of the job, which goes back into
 * the queue and is not charged with it. */
void settlement_decide_unstarted(const error *why, settlement *s);

/* May be called again after a failure. `ending` may be NULL when nothing is known of the process.
 */
bool settlement_apply(queue *q, const char *state_dir, const queue_job *job, const settlement *s,
                      const engine_ending *ending, error *e);

/* Settles what a crash left: jobs that run by the book while nothing runs. */
bool settlement_recover(queue *q, const char *state_dir, error *e);

#endif
