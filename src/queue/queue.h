/* queue: the jobs and their attempts, durable. The only user of SQLite.
 *
 * One process owns the database (a lock on the state directory says so, and SQLite's exclusive
 * locking keeps other programs out) over one connection behind a mutex, so any thread may call any
 * function and none waits for anything but the disk. A function that returns true has its change on disk
 * (WAL, synchronous=FULL). Database trouble is an error with code internal; outputs are then
 * untouched. That changes cannot be stored is logged here, when it begins and when it ends.
 *
 * Every claim of a job raises its attempt number, which is a fence: what an older attempt reports
 * is not accepted. `spent` counts the attempts that weigh against max_attempts; one that the
 * service itself gave back does not.
 *
 * State and transitions:
 *     queued -> running (claim), cancelled (cancel)
 *     running -> succeeded, failed, timed_out (finish), queued (requeue), cancelling (cancel)
 *     cancelling -> cancelled, succeeded, failed, timed_out (finish)
 */
#ifndef HEXAD_QUEUE_QUEUE_H
#define HEXAD_QUEUE_QUEUE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "queue/ulid.h"

typedef struct queue queue;

typedef enum queue_state {
    QUEUE_QUEUED,
    QUEUE_RUNNING,
    QUEUE_CANCELLING,
    QUEUE_SUCCEEDED,
    QUEUE_FAILED,
    QUEUE_CANCELLED,
    QUEUE_TIMED_OUT,
    QUEUE_STATE_COUNT
} queue_state;

typedef enum queue_outcome { QUEUE_NO_OUTCOME, QUEUE_CONVERGED, QUEUE_NOT_CONVERGED } queue_outcome;

const char *queue_state_name(queue_state state); /* "queued", ... */
bool queue_state_from_name(const char *name, queue_state *state);
bool queue_state_is_final(queue_state state);
const char *queue_outcome_name(queue_outcome outcome); /* NULL for no outcome */

typedef struct queue_job {
    char id[ULID_SIZE];
    int64_t seq;  /* order of arrival */
    char *name;   /* NULL: none */
    char *labels; /* opaque to the queue; a JSON array */
    char *spec;   /* opaque to the queue; NULL in a listing */
    queue_state state;
    queue_outcome outcome;
    int priority;                                /* higher runs first */
    int64_t created_ms, started_ms, finished_ms; /* wall clock; 0: not yet */
    int attempt;                                 /* number of the last claim; 0: none */
    int spent, max_attempts;
    char *error_code, *error_message; /* NULL: none */
} queue_job;

void queue_job_clear(queue_job *job); /* frees what it holds; accepts an empty one */
void queue_jobs_free(queue_job *jobs, size_t count);

typedef struct queue_submission {
    const char *name; /* may be NULL */
    const char *labels, *spec;
    int priority, max_attempts;
} queue_submission;

/* How an attempt ended. */
typedef struct queue_ending {
    queue_state state; /* final; for queue_finish */
    queue_outcome outcome;
    const char *error_code, *error_message; /* may be NULL */
    int exit_status, signal;                /* -1: not known or none */
    int64_t peak_memory_bytes;              /* 0: not known */
    const char *reason;                     /* one line for the attempt's record; may be NULL */
} queue_ending;

typedef struct queue_attempt {
    int number;
    int64_t started_ms, finished_ms; /* 0: runs */
    int exit_status, signal;         /* -1: none */
    int64_t peak_memory_bytes;
    char *reason; /* may be NULL */
} queue_attempt;

/* Opens or makes the queue in a directory that exists. Fails when another process holds it (the
 * message says so) or when a newer version of the program made it. */
queue *queue_open(const char *state_dir, error *e);
void queue_close(queue *q); /* accepts NULL */

bool queue_put(queue *q, const queue_submission *submission, char id[ULID_SIZE], error *e);

/* *found false: no such job. The caller clears *job. */
bool queue_get(queue *q, const char *id, queue_job *job, bool *found, error *e);

typedef struct queue_filter {
    int state;          /* a queue_state, or -1: any */
    int64_t before_seq; /* only jobs that came before this one; 0: all */
    int limit;
} queue_filter;

/* Newest first, without their specs. */
bool queue_list(queue *q, const queue_filter *filter, queue_job **jobs, size_t *count, error *e);

/* How many jobs are in each state. */
bool queue_count(queue *q, int64_t count[QUEUE_STATE_COUNT], error *e);

/* Jobs that are running or cancelling by the book; at a start, what a crash left. Oldest first. */
bool queue_list_unsettled(queue *q, queue_job **jobs, size_t *count, error *e);

/* In the order of their numbers. An id that is not there has none. */
bool queue_list_attempts(queue *q, const char *id, queue_attempt **attempts, size_t *count,
                         error *e);
void queue_attempts_free(queue_attempt *attempts, size_t count);

/* The queued job of the highest priority, among equals the oldest, becomes running under a new
 * attempt number. *found false: none is queued. */
bool queue_claim(queue *q, queue_job *job, bool *found, error *e);

/* Ends a job. *accepted false, and nothing changed, when `attempt` is not its current one or the
 * job does not run. */
bool queue_finish(queue *q, const char *id, int attempt, const queue_ending *ending, bool *accepted,
                  error *e);

/* Puts a running job back; `counts` says whether the attempt weighs against max_attempts. *accepted
 * as above; a job that is cancelling is not accepted. */
bool queue_requeue(queue *q, const char *id, int attempt, bool counts, const queue_ending *ending,
                   bool *accepted, error *e);

/* A queued job becomes cancelled, a running one cancelling; any other stays. *now is the state
 * afterwards and *changed whether this call made it so. */
bool queue_cancel(queue *q, const char *id, bool *found, bool *changed, queue_state *now, error *e);

#endif
