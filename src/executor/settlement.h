/* settlement: what becomes of a task whose attempt has ended.
 *
 * Deciding looks only at how the attempt ended and what it left; applying moves the result into
 * place and tells the queue, in an order that a crash at any point leaves recoverable:
 *     the attempt's directory is renamed to results/ID and both parents are flushed,
 *     then the queue's transaction ends the task.
 * A start after a crash finds a task still running in the queue and, if results/ID is whole, only the
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

/* What becomes of the task. */
typedef enum settlement_verdict {
    SETTLEMENT_UNDECIDED, /* the result cannot be read at the moment (message says why): decide again later */
    SETTLEMENT_SUCCEED, /* the attempt's directory is a result: it is delivered and the task has succeeded */
    SETTLEMENT_END,     /* the task ends without a result, in `state` */
    SETTLEMENT_RETRY,   /* queued again; the attempt does not count */
    SETTLEMENT_RETRY_INTERRUPTED, /* the same, because the daemon or the host ended during the attempt */
    SETTLEMENT_RETRY_CRASHED,     /* queued again after a wait; the attempt counts */
    SETTLEMENT_RETRY_STORAGE /* queued again after a wait, because a disk was full or failed, as code and message
                                     say; it does not count, but the number of such retries is limited */
} settlement_verdict;

typedef struct settlement {
    settlement_verdict verdict;
    queue_state
        state; /* the task's final state, with SUCCEED, END, and RETRY_STORAGE when no retry is left */
    queue_outcome outcome; /* with SUCCEED */
    error_code code;       /* ERROR_NONE: no error */
    char message[sizeof((error *)0)->message];
    char reason[160];        /* for the attempt's record */
    int64_t ran_ms;          /* how long the attempt ran; 0: not known */
    bool in_place;           /* with SUCCEED: the result is already in results/ */
    bool keep;               /* with RETRY_STORAGE: the directory holds a result for the next attempt */
    const char *copied;      /* as queue_ending's */
    const char *cached_from; /* with SUCCEED: the job that computed the result, or NULL */
    const char *cache_key, *cache_inputs; /* with SUCCEED: as queue_ending's */
} settlement;

/* What a worker says in its last line, when that is the JSON object of the contract. */
bool settlement_read_last_words(const char *words, error *said);

/* `limit_s` is the limit that was hit when `stop` says that one was. */
void settlement_decide(const queue_claimed *claimed, settlement_stop stop, double limit_s,
                       const engine_ending *ending, const char *directory, settlement *s);

/* For an attempt that did not start: a fault of the service, not of the job, which goes back into
 * the queue and is not charged with it. */
void settlement_decide_unstarted(const error *why, settlement *s);

/* For an attempt that was not even tried, since the machine can never give what the job asks for. */
void settlement_decide_too_large(const queue_claimed *claimed, int64_t memory_mb, settlement *s);

/* For one whose task ran as long as it may in attempts before. */
void settlement_decide_late(double limit_s, settlement *s);

/* For a directory that was given the result of another job, whose id lives on. */
bool settlement_decide_cached(const char *directory, const char *from, settlement *s, error *e);

/* For a directory that was given the result which an attempt before could not copy to where its job wants it. */
bool settlement_decide_kept(const char *directory, settlement *s, error *e);

/* For a result that could not be copied to where its job wants it: the job fails, or is tried again when a disk was
 * at fault. */
void settlement_decide_unpublished(const error *why, settlement *s);

/* How long a task waits whose attempt crashed: `first_s` after the first attempt that counts, twice as long
 * after each further one, up to `most_s`. */
typedef struct settlement_backoff {
    double first_s, most_s;
} settlement_backoff;

/* What is settled: the queue, its directory, and how it goes on. */
typedef struct settlement_place {
    queue *q;
    const char *state_dir;
    const char *host; /* for the attempts' records */
    settlement_backoff backoff;
    int storage_retries;   /* how often a task is tried again because a disk was full or failed */
    int max_interruptions; /* of a task; 0: any number */
} settlement_place;

/* May be called again after a failure. `ending` may be NULL when nothing is known of the process.
 */
bool settlement_apply(const settlement_place *place, const queue_claimed *claimed, const settlement *s,
                      const engine_ending *ending, error *e);

/* Removes what an attempt left in its directory, but for its log. */
void settlement_remove_leftovers(const char *directory);

/* Settles what a crash left: tasks that the queue holds as running while nothing runs. Such an attempt does not count, since it
 * was not its doing; too many of a task end it (error interrupted). `restarted`: the host was meanwhile, too. */
bool settlement_recover(const settlement_place *place, bool restarted, error *e);

#endif
