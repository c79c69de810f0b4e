// SPDX-License-Identifier: Apache-2.0
/* queue: the durable store of jobs, their tasks and attempts, and their events.
 *
 * One process owns the database. It locks the state directory, and a lock on the database excludes other
 * programs.
 * One connection writes; others read without waiting for changes (service/database/database.h). Any thread
 * may call any function. When a function returns true, its change is on disk (WAL, synchronous=FULL).
 * Concurrent changes of several threads share one transaction and one flush. No reader sees a change before
 * it is durable. If the database fails, the error has the code internal, storage_full, database_damaged or
 * state_lost, and outputs are unchanged. The first failed change, and the first successful change after it,
 * are logged.
 *
 * A job has one task, or one task per frame. A task is executed by attempts. Every claim of a task increments
 * its attempt number. This number is a fence: the queue rejects reports of older attempts. `spent` is the
 * number of attempts that count against max_attempts. Attempts that the service itself put back do not count.
 *
 * The state of a job follows from its tasks and from the commands that it received. It is updated in the
 * transaction that changes these.
 *     queued      waits for a claim; between two frames a job stays running
 *     blocked     waits for the jobs that it depends on
 *     paused      no attempt is started until the job is resumed; while earlier attempts still run, the job
 *                 is running
 *     running     an attempt runs
 *     cancelling  an attempt runs and was requested to end
 *     succeeded, failed, timed_out, cancelled: every task has ended. If tasks ended differently, the job
 *     takes the
 *                 first of failed, timed_out, cancelled. A job that was cancelled is cancelled.
 * A task is queued, running, or in a final state. Only a retry leaves a final state.
 */
#ifndef HEXAD_SERVICE_QUEUE_QUEUE_H
#define HEXAD_SERVICE_QUEUE_QUEUE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/runner.h"
#include "base/core/running_time.h"
#include "service/database/health.h"
#include "base/core/ulid.h"
#include "service/queue/user_numbers.h"

typedef struct queue queue;

typedef enum queue_state {
    QUEUE_QUEUED,
    QUEUE_BLOCKED,
    QUEUE_PAUSED,
    QUEUE_RUNNING,
    QUEUE_CANCELLING,
    QUEUE_SUCCEEDED,
    QUEUE_FAILED,
    QUEUE_CANCELLED,
    QUEUE_TIMED_OUT,
    QUEUE_STATE_COUNT
} queue_state;

/* From best to worst. doc/report.md defines them. */
typedef enum queue_outcome {
    QUEUE_NO_OUTCOME,
    QUEUE_CONVERGED,
    QUEUE_UNRESOLVED,
    QUEUE_NOT_CONVERGED
} queue_outcome;

/* A set of outcomes has a bit for each. */
#define QUEUE_OUTCOME_BIT(outcome) (1u << (outcome))
#define QUEUE_ANY_OUTCOME                                                       \
    (QUEUE_OUTCOME_BIT(QUEUE_CONVERGED) | QUEUE_OUTCOME_BIT(QUEUE_UNRESOLVED) | \
     QUEUE_OUTCOME_BIT(QUEUE_NOT_CONVERGED))

const char *queue_state_name(queue_state state); /* "queued", ... */
bool queue_state_from_name(const char *name, queue_state *state);
bool queue_state_is_final(queue_state state);
const char *queue_outcome_name(queue_outcome outcome);   /* NULL for no outcome */
queue_outcome queue_outcome_from_name(const char *name); /* QUEUE_NO_OUTCOME for NULL and other words */

/* Opens or creates the queue in an existing directory. Errors: database_damaged, storage_full, internal.
 * internal: another process has locked the directory, it is on a network file system, or a newer version of
 * the program created the database. */
queue *queue_open(const char *state_dir, error *e);
/* Opens a copy of a database (service/database/backup) for reading. The copy is migrated if it has an
 * older version. */
queue *queue_open_copy(const char *path, error *e);
void queue_close(queue *q); /* accepts NULL */

/* The database, for backups and checks (service/database/backup, service/database/checker). Owned by the
 * queue. */
struct database *queue_database(queue *q);

/* Reserves `bytes` of disk space for the database, so that jobs can still be cancelled, deleted and ended if
 * the disk is full. New jobs are accepted only while that amount is free in addition. 0: no reserve. If the
 * space cannot be reserved, a warning is logged. */
void queue_reserve(queue *q, int64_t bytes);

/* The service instance that owns the database (service/results/instance_check.h), and the boot of the host in
 * which the daemon last ran. */
typedef struct queue_instance {
    char id[ULID_SIZE]; /* "": the database comes from a version without instance ids */
    char boot_id[40];   /* "": unknown */
} queue_instance;

/* *found is false if the database is new. */
bool queue_get_instance(queue *q, queue_instance *instance, bool *found, error *e);
bool queue_set_instance(queue *q, const queue_instance *instance, error *e);

/* ---- health */

void queue_get_health(queue *q, health_report *known);

/* False if the database is damaged. The error describes the damage and the required actions. */
bool queue_allows_changes(queue *q, error *e);
/* Whether the state directory is still at its path. Otherwise every change fails with the same error
 * (state_lost). */
bool queue_has_place(queue *q, error *e);

/* ---- jobs */

typedef struct queue_counts { /* tasks; the sum of all but `all` is `all` */
    int all, waiting, running, succeeded, failed, cancelled, timed_out;
} queue_counts;

#define QUEUE_NO_FRAME INT32_MIN

typedef struct queue_job {
    char id[ULID_SIZE];
    int64_t seq;      /* order of arrival */
    uint64_t stamp;   /* set by queue_get, see queue_stamp; or QUEUE_NO_STAMP */
    int64_t revision; /* incremented by every change of a member of this struct */
    char *name;       /* NULL: none */
    char *owner;      /* the user; "": unknown */
    char *labels;     /* a JSON array of strings */
    char *trace;      /* traceparent; NULL: none */
    char *spec;       /* opaque to the queue; in a listing NULL except for short ones of jobs without name */
    char *paths;      /* see queue_submission; NULL in a listing */
    queue_state state;
    queue_outcome outcome; /* the worst of its tasks */
    bool accepted; /* it has succeeded, and `accept` of the submission contains the outcomes of all tasks */
    bool paused;
    bool array; /* has one task per frame */
    queue_counts tasks;
    int attempts; /* sum over all tasks */
    int priority; /* higher runs first */
    int max_attempts;
    int threads;                                 /* of an attempt */
    int64_t memory_mb;                           /* of an attempt */
    int64_t created_ms, started_ms, finished_ms; /* wall clock; 0: not yet */
    int64_t retention_s;                         /* after its end; 0: unlimited */
    char *error_code, *error_message;            /* NULL: none */
    char *cached_from; /* the job whose result was reused; NULL: this job computed its own */
    bool cached_shown; /* the owner may learn of that job (service/queue/relation) */
    /* state of the copy to its directory: delivered, failed, pending; NULL: not tried yet */
    char *copy_state;
    char *copy_code, *copy_message; /* if the state is failed */
} queue_job;

void queue_job_clear(queue_job *job); /* frees its members; accepts a zeroed job */
void queue_jobs_free(queue_job *jobs, size_t count);

typedef struct queue_submission {
    const char *name;   /* may be NULL */
    const char *owner;  /* NULL: "" */
    const char *labels; /* a JSON array of strings */
    const char *trace;  /* may be NULL */
    const char *spec;
    const char *paths; /* opaque: the paths of the spec as the client wrote them; or NULL */
    int priority, max_attempts, threads;
    int64_t memory_mb, retention_s;
    const int *frames; /* one task for each, in this order, without duplicates; NULL: one task */
    size_t frame_count;
    /* The tasks run one after another, each starting from the result of the task before. A task that does not
     * succeed ends the later ones, except that one that fails with no_surface is skipped. */
    bool ordered;
    const char *const
        *depends_on; /* ids of jobs that must succeed, and be accepted, before this one starts */
    size_t depends_on_count;
    const char *const *after; /* ids of jobs that must end before this one starts */
    size_t after_count;
    /* ids of arrays that have all of `frames`: a task starts when the tasks of the same frame in these arrays
     * have succeeded and were accepted */
    const char *const *after_frames;
    size_t after_frames_count;
    bool any_frames; /* after_frames may name jobs of other users: the owner is an administrator */
    unsigned accept; /* set of outcomes with which jobs that depend on this one start; 0: all */
    int max_running; /* tasks of the job that run at the same time; 0: any number */
    int chunk; /* consecutive tasks that run one after another (queue_claim); 0 and 1: none. 1 if `ordered` */
    const char *const *inputs; /* names of the uploaded files that all tasks read */
    size_t input_count;
    const char *const *files;       /* for each of `frames` the name of its file, opaque; NULL: none */
    const char *const *file_inputs; /* names of the uploaded files that single tasks read */
    size_t file_input_count;
    int64_t timeout_ms, stall_ms; /* limits of an attempt; 0: the service's own */
    const char *directory;        /* directory for a copy of the results, see frames_path; NULL: no copy */
    const char *cache_key;        /* jobs with the same key have the same result; NULL: it is not reused */
    const char *webhook;          /* URL to notify of the job's end; or NULL */
    const char *key, *body_hash;  /* idempotency: both or none; each owner has separate keys */
    int64_t most_waiting;         /* maximum number of unfinished jobs of the owner; 0: no maximum */
    int64_t most_tasks;           /* maximum number of unfinished tasks of the owner; 0: no maximum */
} queue_submission;

typedef enum queue_admission {
    QUEUE_CREATED,
    QUEUE_REPLAYED,          /* the key was used with this body; the receipt has the job of that submission */
    QUEUE_MISMATCH,          /* the key was used with another body, for the job in the receipt */
    QUEUE_TOO_MANY,          /* the owner has most_waiting jobs */
    QUEUE_TOO_MANY_TASKS,    /* the owner would have more than most_tasks tasks */
    QUEUE_RESULTS_FULL,      /* a bound on all results is reached and none may be deleted (queue_bounds) */
    QUEUE_USER_RESULTS_FULL, /* a bound on the owner's results is reached */
    QUEUE_NO_SPACE,          /* free disk space is below the reserve of queue_reserve */
    QUEUE_UNKNOWN_DEPENDENCY,  /* the receipt has the index in depends_on, continued in after and
                                * after_frames */
    QUEUE_FOREIGN_DEPENDENCY,  /* the receipt has the index of a job in after_frames that belongs to another
                                * user */
    QUEUE_REPEATED_DEPENDENCY, /* the receipt has the index of a job in after_frames that was listed before */
    /* the receipt has the index of a job in after_frames that lacks `frame` of the receipt; QUEUE_NO_FRAME:
     * it is not an array */
    QUEUE_UNKNOWN_FRAME
} queue_admission;

typedef struct queue_receipt {
    queue_admission admission;
    char id[ULID_SIZE];
    /* queued, blocked, or failed: a job that it depends on has failed or is not accepted */
    queue_state state;
    int64_t seq, revision;
    size_t dependency;
    int frame;
} queue_receipt;

/* Stores the job if `receipt->admission` is QUEUE_CREATED, and nothing otherwise. A job with many tasks is stored
 * in several transactions; no function returns it before the last one. A submission with the same owner and key
 * waits meanwhile. */
bool queue_put(queue *q, const queue_submission *submission, queue_receipt *receipt, error *e);

/* Whether the owner has used this idempotency key. */
bool queue_has_key(queue *q, const char *owner, const char *key, bool *found, error *e);

/* *found is false if there is no such job. The caller clears *job. */
bool queue_get(queue *q, const char *id, queue_job *job, bool *found, error *e);

/* A number that changes with every change of the job `seq` or of its attempts, and sometimes with a change of
 * another job. While it equals the stamp that queue_get returned, that job is up to date. It changes before
 * the function that made the change returns. Does not read the database. */
#define QUEUE_NO_STAMP UINT64_MAX /* the job may have changed during the read; no job has this stamp */
uint64_t queue_stamp(queue *q, int64_t seq);

/* Sort key of a list: order of arrival, name (ASCII case-insensitive, jobs without a name first), owner, word
 * for the state, priority. Ties are sorted by arrival. */
typedef enum queue_order {
    QUEUE_BY_AGE,
    QUEUE_BY_NAME,
    QUEUE_BY_OWNER,
    QUEUE_BY_STATE,
    QUEUE_BY_PRIORITY
} queue_order;
#define QUEUE_ORDER_COUNT 5

typedef struct queue_filter {
    int state;                        /* a queue_state; -1: any */
    unsigned states;                  /* several states, a bit for each queue_state; 0: use `state` */
    const char *owner, *label, *name; /* NULL: any */
    const char *needs;                /* id of a job that it depends on (depends_on, after); NULL: any */
    const char *text;                 /* substring of the name, ASCII case-insensitive; NULL: any */
    int64_t since_ms, until_ms;       /* created at or after since_ms, and before until_ms; 0: any */
    queue_order order;
    bool rising;           /* ascending: smallest or oldest first */
    int64_t after_seq;     /* only jobs after this one in the list; 0: all */
    const char *after_key; /* result of queue_sort_key for that job; not needed BY_AGE */
    int limit;
} queue_filter;

/* A position in a list: result of queue_sort_key for the job there (BY_AGE: NULL), and its seq. */
typedef struct queue_place {
    int64_t seq; /* 0: none */
    char *key;
} queue_place;

typedef struct queue_page {
    queue_job *jobs; /* see queue_job.spec */
    size_t count;
    queue_place stop; /* last job that was visited; seq 0: the list ended before, or at the limit */
} queue_page;

/* Maximum number of jobs that a page of a list visits. */
#define QUEUE_VISITS 4096

/* Lists jobs among the next `visits` jobs of the list (0: among all). Each visited job costs a lookup, each
 * listed job a few. If more jobs follow, page->stop is the last visited one, listed or not; the page may
 * be short or empty. */
bool queue_list_page(queue *q, const queue_filter *filter, int visits, queue_page *page, error *e);
void queue_page_clear(queue_page *page);

/* Lists the first jobs; visits any number of jobs. */
bool queue_list(queue *q, const queue_filter *filter, queue_job **jobs, size_t *count, error *e);

#define QUEUE_SORT_KEY_SIZE 256
/* The sort key of a job, as text. */
const char *queue_sort_key(const queue_job *job, queue_order order, char text[QUEUE_SORT_KEY_SIZE]);
/* Negative if `a` precedes `b` in the list of the filter. */
int queue_compare(const queue_job *a, const queue_job *b, const queue_filter *filter);

/* The jobs of a user that read an uploaded file: the ids of at most QUEUE_INPUT_IDS_MOST, the newest first, and the
 * numbers of all and of the unfinished ones. */
#define QUEUE_INPUT_IDS_MOST 100
typedef struct queue_input_jobs {
    char id[QUEUE_INPUT_IDS_MOST][ULID_SIZE];
    size_t id_count;
    int64_t all, unfinished;
} queue_input_jobs;
bool queue_list_input_jobs(queue *q, const char *name, const char *owner, queue_input_jobs *jobs, error *e);

/* The number of jobs in each state. */
bool queue_count(queue *q, int64_t count[QUEUE_STATE_COUNT], error *e);

typedef struct queue_figures {
    /* Wall clock: when the first of the queued jobs began to wait; 0: none is queued. */
    int64_t waiting_since_ms;
    int64_t deliveries;        /* pending deliveries of webhooks */
    int64_t delivery_since_ms; /* wall clock: end of the job of the first of them; 0: none */
    int64_t undelivered;       /* jobs whose results were neither copied to output.directory nor downloaded */
    int64_t database_bytes;
} queue_figures;

/* Costs a few lookups, whatever the number of jobs, and a walk over deliveries and undelivered jobs. */
bool queue_get_figures(queue *q, queue_figures *figures, error *e);

typedef enum queue_command {
    QUEUE_CANCEL, /* waiting tasks are cancelled; running ones are signalled to end */
    QUEUE_PAUSE,
    QUEUE_RESUME,
    /* For an ended job: its tasks without success are queued again, with all attempts available. */
    QUEUE_RETRY,
    /* For an ended job with a directory: its results are copied again, or only those whose copies failed
     * (queue_next_uncopied). */
    QUEUE_DELIVER
} queue_command;

/* Applies a command to a job. *now: the state afterwards. *changed: false if the command does not apply, such
 * as a cancellation of an ended job, or a retry of a job that depends on a failed one. */
bool queue_apply_command(queue *q, const char *id, queue_command command, bool *found, bool *changed,
                         queue_state *now, error *e);

/* As queue_apply_command, without the changes of many tasks that follow: queue_complete makes them. The command
 * is stored; after a crash queue_do_piece completes it. */
bool queue_begin_command(queue *q, const char *id, queue_command command, bool *found, bool *changed,
                         queue_state *now, error *e);
/* Makes the changes of many tasks that commands on the job require. *now is unchanged if there is no such job. */
bool queue_complete(queue *q, const char *id, queue_state *now, error *e);

/* Makes some of the changes of many tasks, of one user after the other, and of jobs that wait for ended ones. *more:
 * there may be further ones. One thread calls it, after each change of the queue. */
bool queue_do_piece(queue *q, bool *more, error *e);

typedef struct queue_retried {
    size_t count;              /* number of retried jobs */
    char (*others)[ULID_SIZE]; /* jobs that were not retried, in order of arrival; to be freed */
    size_t other_count;
} queue_retried;

/* Retries, one after another, the jobs that ended as dependency_failed because of this one, and their dependents
 * in turn. Jobs that still depend on a failed one are returned in `others`. `owner`: jobs of other owners are
 * neither retried nor returned; NULL: all are retried. */
bool queue_retry_dependents(queue *q, const char *id, const char *owner, queue_retried *retried, error *e);

typedef struct queue_edit {
    const int *priority;        /* NULL: stays */
    const char *labels;         /* NULL: stay */
    const int64_t *retention_s; /* NULL: unchanged; counts from the job's end, also if it has ended */
    const int *max_running;     /* NULL: unchanged. Running tasks continue */
    const unsigned *accept; /* NULL: unchanged. Dependent jobs that have started or failed stay as they are */
} queue_edit;

typedef enum queue_edited { QUEUE_EDITED, QUEUE_NOT_THERE, QUEUE_STALE } queue_edited;

/* If the job's revision is not `revision` (-1: any), nothing changes and *edited is QUEUE_STALE. */
bool queue_change(queue *q, const char *id, int64_t revision, const queue_edit *edit, queue_edited *edited,
                  error *e);

/* Deletes an ended job, and records its directories for removal (see queue_removal), after the changes of many
 * tasks of the job and of jobs that wait for its frames. *deleted is false if the job has not ended. On an error
 * *deleted may be true: the job is hidden, and queue_delete_hidden deletes the rest. */
bool queue_delete(queue *q, const char *id, bool *found, bool *deleted, error *e);

/* Deletes the rest of one job that was deleted or stored in part. *more: there was one. */
bool queue_delete_hidden(queue *q, bool *more, error *e);

/* The ids of at most `limit` jobs whose retention has ended by one of these bounds, in one array that the
 * caller frees. */
bool queue_list_expired(queue *q, const running_bound *bounds, size_t bound_count, int limit,
                        char (**ids)[ULID_SIZE], size_t *count, error *e);
/* The end of the next retention after `after_ms`, both by the wall clock; INT64_MAX: none. */
bool queue_next_expiry(queue *q, int64_t after_ms, int64_t *wall_ms, error *e);

/* The running time of the daemon: the stored periods, and the one that began with queue_open. The caller
 * stores them periodically with queue_store_running; time since the last store is lost in a crash. */
running_time *queue_running(queue *q);
bool queue_store_running(queue *q, error *e);

/* ---- tasks and attempts */

typedef struct queue_task {
    int number;        /* 0, 1, ... in the job */
    int frame;         /* QUEUE_NO_FRAME: the job is not an array */
    char *file;        /* see queue_submission.files; NULL: none */
    queue_state state; /* queued, running or final */
    queue_outcome outcome;
    int attempt;           /* number of the last claim; 0: none */
    int spent;             /* number of attempts that count */
    int storage_faults;    /* number of attempts that do not count because a disk was full or failed */
    int interrupted;       /* number of attempts that ended with the daemon or its host */
    int64_t ran_ms;        /* running time of the attempts that count and were put back */
    int64_t not_before_ms; /* queued: earliest time of the next attempt; 0: now */
    int64_t started_ms, finished_ms;
    int waits;                        /* queued: number of frames of other jobs that it waits for */
    char *error_code, *error_message; /* NULL: none */
} queue_task;

void queue_task_clear(queue_task *task);
void queue_tasks_free(queue_task *tasks, size_t count);

/* Lists tasks by number, after the number `after` (-1: all). Empty if there is no such job. */
bool queue_list_tasks(queue *q, const char *id, int after, int limit, queue_task **tasks, size_t *count,
                      error *e);
bool queue_get_frame(queue *q, const char *id, int frame, queue_task *task, bool *found, error *e);

typedef struct queue_attempt {
    int task, frame, number;
    int64_t started_ms, finished_ms; /* finished_ms 0: running */
    int exit_status, signal;         /* -1: none */
    int64_t peak_memory_bytes;
    int64_t waited_ms, processor_ms; /* 0: unknown, or none */
    char *host;                      /* where it ran; or NULL */
    char *reason;                    /* may be NULL */
} queue_attempt;

/* Lists attempts by task and number, after attempt `after` of the task `after_task` (-1: all). Empty if there
 * is no such job. */
bool queue_list_attempts(queue *q, const char *id, int after_task, int after, int limit,
                         queue_attempt **attempts, size_t *count, error *e);
void queue_attempts_free(queue_attempt *attempts, size_t count);

/* ---- running */

typedef struct queue_claimed {
    queue_job job;
    queue_task task;
    int64_t timeout_ms, stall_ms; /* these and the next members: see queue_submission */
    char *directory, *cache_key;
    char **inputs; /* those that all tasks read */
    size_t input_count;
    int previous; /* in an ordered job: the last earlier frame that succeeded; QUEUE_NO_FRAME: none */
    int chunk;    /* number of its chunk in the job; -1: none */
    bool more;    /* queue_claim_in_chunk would find another task now */
} queue_claimed;

void queue_claimed_clear(queue_claimed *claimed);
void queue_claimed_free(queue_claimed *claimed, size_t count);

/* Free and total resources of this host. A job that requests more threads than there are gets all of them. A
 * job that requests more memory than there is is claimed at once, so that the executor can fail it. */
typedef struct queue_resources {
    int threads, all_threads;
    int64_t memory_mb, all_memory_mb;
    int most_of_owner;           /* maximum number of running tasks of one owner; 0: no maximum */
    const user_numbers *weights; /* relative number of turns of each owner; NULL: 1 for each */
} queue_resources;

/* Maximum number of later claims that may overtake a job that does not fit. After that all others wait for
 * it. */
#define QUEUE_OVERTAKE_MOST 16

/* Claims a task of a job with the highest priority that fits into the free resources. Owners of such jobs
 * take turns; of the jobs of one owner the oldest comes first. The claimed task is the first one that can
 * start and is not in a chunk with a running task. The task becomes running with a new attempt number. *found
 * is false if no task may run now. */
bool queue_claim(queue *q, const queue_resources *resources, queue_claimed *claimed, bool *found, error *e);

/* Claims the next task that can start in the chunk of the task with the number `task`, which was claimed
 * before, for an engine that runs the claimed tasks of a chunk one after another. Other limits are those
 * of queue_claim. */
bool queue_claim_in_chunk(queue *q, const queue_resources *resources, const char *id, int task,
                          queue_claimed *claimed, bool *found, error *e);

/* Counts the jobs of the job's owner that are claimed before it: those with a task that may be claimed and a higher
 * priority, or the same priority and an earlier arrival. *count is at most QUEUE_AHEAD_MOST. Jobs that do not fit
 * into the free resources may be overtaken. */
#define QUEUE_AHEAD_MOST 100
bool queue_count_ahead(queue *q, const queue_job *job, int *count, error *e);

/* Claims the first queued task of one job, whatever the free resources. */
bool queue_claim_job(queue *q, const char *id, queue_claimed *claimed, bool *found, error *e);

/* While the queue is held, queue_claim finds nothing. The hold persists over restarts. */
bool queue_hold(queue *q, bool on, error *e);
bool queue_is_held(queue *q, bool *held, error *e);

/* Call it after the wall clock was set back: limits the remaining waits of delayed tasks and notifications to
 * the delay that was set after their last attempt. */
bool queue_shorten_waits(queue *q, error *e);

/* When the next delayed task is due, wall clock; INT64_MAX: there is none. */
bool queue_next_due(queue *q, int64_t *wall_ms, error *e);

/* Lists running tasks, oldest first. At a start these are the ones left by a crash. */
bool queue_list_unsettled(queue *q, queue_claimed **claimed, size_t *count, error *e);

/* The end of an attempt. */
typedef struct queue_ending {
    queue_state state; /* final; for queue_finish */
    queue_outcome outcome;
    const char *error_code, *error_message; /* may be NULL */
    int exit_status, signal;                /* -1: unknown or none */
    int64_t peak_memory_bytes;              /* 0: unknown */
    int64_t waited_ms;       /* time in the queue of a farm, before its worker started; 0: unknown */
    int64_t processor_ms;    /* CPU time of its worker; 0: unknown */
    int64_t ran_ms;          /* for queue_requeue; 0: unknown */
    bool interrupted;        /* for queue_requeue: the daemon or its host ended */
    const char *host;        /* may be NULL */
    const char *reason;      /* one line for the attempt's record; may be NULL */
    const char *cached_from; /* the job whose result was reused; may be NULL */
    bool storage_fault;      /* for queue_requeue: a disk was full or failed */
    int64_t bytes;           /* disk space that the attempt uses after its end */
    bool delivered;          /* for queue_finish: the result was copied to output.directory */
    bool copy_pending;       /* for queue_finish: the result has to be copied, see queue_next_uncopied */
    const char *copy_code, *copy_message; /* for queue_finish: the result could not be copied; may be NULL */
    const char *copied;                   /* record of queue_note_copy to delete; may be NULL */
    const char *cache_key,
        *cache_inputs; /* Both or none: other jobs may reuse the result, see queue_recall. */
} queue_ending;

/* Identifies one attempt. */
typedef struct queue_fence {
    const char *id;
    int task, attempt;
} queue_fence;

/* Ends a task. If the attempt is not the current one, or the task does not run, nothing changes and *accepted
 * is false. */
bool queue_finish(queue *q, const queue_fence *fence, const queue_ending *ending, bool *accepted, error *e);

/* Queues a running task again. `counts`: the attempt counts against max_attempts, and its time against the
 * time limit. The next attempt starts at `not_before_ms` (wall clock; 0: now) or later. *accepted: see
 * queue_finish; also false if the job is cancelling. */
bool queue_requeue(queue *q, const queue_fence *fence, bool counts, int64_t not_before_ms,
                   const queue_ending *ending, bool *accepted, error *e);

/* Finds the job whose result was stored last with this key, and the inputs stored with it; the caller
 * frees these. */
bool queue_recall(queue *q, const char *key, char id[ULID_SIZE], char **inputs, bool *found, error *e);

/* A job that has succeeded with the result of another job. */
typedef struct queue_reused {
    int64_t seq;
    char id[ULID_SIZE], from[ULID_SIZE];
    char *spec;
} queue_reused;

void queue_reused_free(queue_reused *jobs, size_t count);

/* Lists such jobs with a seq above `after`. Reads all jobs. */
bool queue_list_reused(queue *q, int64_t after, int limit, queue_reused **jobs, size_t *count, error *e);

/* Whether reports of such jobs may be hard links made by an earlier version (service/results/own_report). */
bool queue_has_linked_reports(queue *q, bool *has, error *e);
bool queue_note_own_reports(queue *q, error *e);

/* ---- temporary files of copies of results, in output directories */

typedef struct queue_copy {
    char *directory, *name;
} queue_copy;

void queue_copies_free(queue_copy *copies, size_t count);

/* Records that a temporary file with this name may be created in the directory; names are unique. Also
 * records that the report in that directory, whose path without links is `output`, belongs to the owner
 * from now on. */
bool queue_note_copy(queue *q, const char *directory, const char *name, const char *output, const char *owner,
                     error *e);
/* The user for whom the last report was delivered to this directory; the caller frees it. NULL: unknown. */
bool queue_get_output_owner(queue *q, const char *output, char **owner, error *e);
bool queue_forget_copy(queue *q, const char *name, error *e);
bool queue_list_copies(queue *q, queue_copy **copies, size_t *count, error *e);

/* An ended job whose results have to be copied to its directory. */
typedef struct queue_uncopied {
    int64_t seq;
    char id[ULID_SIZE];
    char *owner, *directory;
    queue_task *tasks; /* number and frame are set */
    size_t count;
} queue_uncopied;

void queue_uncopied_clear(queue_uncopied *job);

/* Finds the first such job (QUEUE_DELIVER, queue_ending.copy_pending) with a seq above `after`. */
bool queue_next_uncopied(queue *q, int64_t after, queue_uncopied *job, bool *found, error *e);
/* Records that the result of a task was copied, or (`fault` not NULL) why not, and deletes the record of the
 * copy `name`. */
bool queue_note_copied(queue *q, const char *id, const queue_task *task, const error *fault, const char *name,
                       error *e);
/* Records that copying of all tasks of the job was attempted. */
bool queue_end_copying(queue *q, const char *id, error *e);

/* ---- events */

typedef enum queue_event_type {
    QUEUE_EVENT_STATE,   /* the new state of the job is `state` */
    QUEUE_EVENT_TASK,    /* the new state of a task of an array is `state` */
    QUEUE_EVENT_STARTED, /* an attempt was claimed */
    QUEUE_EVENT_ENDED,   /* an attempt has ended; see queue_list_attempts */
    /* priority, labels or retention changed; or a pause or resumption that did not change the state */
    QUEUE_EVENT_EDITED,
    QUEUE_EVENT_TYPE_COUNT
} queue_event_type;

const char *queue_event_type_name(queue_event_type type); /* "state", ... */

#define QUEUE_OWNER_SIZE 65

typedef struct queue_event {
    int64_t seq; /* one ascending sequence for all jobs; numbers are never reused */
    int64_t at_ms;
    char id[ULID_SIZE];           /* of the job */
    char owner[QUEUE_OWNER_SIZE]; /* of the job */
    queue_event_type type;
    queue_state state;     /* of the job, or of the task */
    queue_outcome outcome; /* with a final state */
    int frame;             /* QUEUE_NO_FRAME: none */
    int attempt;           /* 0: none */
} queue_event;

/* Value of `after_seq`: only events from now on. */
#define QUEUE_EVENTS_FROM_NOW (-1)

typedef struct queue_event_filter {
    const char *id, *owner, *label; /* NULL: any; the label is one that the job has now */
    int64_t after_seq;
    int limit;
} queue_event_filter;

typedef struct queue_event_page {
    queue_event *events; /* oldest first; to be freed */
    size_t count;
    int64_t position; /* start of the next page: all events up to this number were read */
    bool more;        /* more events may exist now: the page is full, or the bound was reached */
    int64_t newest;   /* the highest number so far; a page after it is empty, with this position */
    /* Some events up to this number were deleted with their jobs. 0: none, or the page is of one job, whose
     * events are deleted together. */
    int64_t removed_up_to;
} queue_event_page;

/* Reads a bounded number of events in order of their numbers (with a job id: only the events of that job). A
 * page may therefore be empty although more events follow. The events of a job are deleted with it. */
bool queue_list_events(queue *q, const queue_event_filter *filter, queue_event_page *page, error *e);

/* ---- directories of tasks: to be removed, and found at a start */

/* A deleted task, whose result and attempts 1 .. `attempts` have to be removed. The transaction that deletes
 * the job stores this record. Results are removed only because of such a record. */
typedef struct queue_removal {
    int64_t number; /* ascending */
    char id[ULID_SIZE];
    int frame, attempts;
} queue_removal;

/* Lists removals with numbers above `after`, of one job or (id NULL) of all jobs. The caller frees them. */
bool queue_list_removals(queue *q, const char *id, int64_t after, int limit, queue_removal **removals,
                         size_t *count, error *e);
/* Deletes at most 1000 records, after the directories were removed. */
bool queue_end_removals(queue *q, const queue_removal *removals, size_t count, error *e);

/* A directory that belongs to a task by its name, and the state of that task in the queue. */
typedef struct queue_directory {
    char *name;         /* not used by the queue */
    char id[ULID_SIZE]; /* "": the name is not that of a task */
    int frame;
    int attempt;        /* 0: a result */
    bool to_be_removed; /* see queue_removal */
    bool known;         /* the task exists, and the next members are set */
    queue_state state;  /* queued, running or final */
    int last_attempt;
} queue_directory;

/* Sets the members that the queue has. Costs one index lookup per directory. */
bool queue_find_directories(queue *q, queue_directory *directories, size_t count, error *e);
/* Lists the results that succeeded tasks have: ids and frames. The caller frees the list, also on failure. */
bool queue_list_results(queue *q, queue_directory **results, size_t *count, error *e);

/* Ends a waiting task whose result was found, because the database is older than the result. *accepted is
 * false if the task does not wait. */
bool queue_end_found(queue *q, const char *id, int frame, queue_outcome outcome, bool *accepted, error *e);

/* A job that is missing in the queue, from its results. It has succeeded. */
typedef struct queue_adopted_task {
    int frame;  /* QUEUE_NO_FRAME: the only task */
    char *file; /* NULL: none */
    queue_outcome outcome;
    int64_t finished_ms;
} queue_adopted_task;

typedef struct queue_adoption {
    char id[ULID_SIZE];
    char *name;   /* may be NULL */
    char *labels; /* a JSON array of strings */
    char *spec;
    int priority, max_attempts, threads;
    int64_t memory_mb;
    queue_adopted_task *tasks;
    size_t task_count;
} queue_adoption;

/* Adds the jobs to the queue, all or none. Their owner is "" and they are kept until they are deleted. */
bool queue_adopt(queue *q, const queue_adoption *jobs, size_t count, error *e);

/* ---- uploaded files (service/uploads/upload_store) */

#define QUEUE_HASH_SIZE 65 /* of a SHA-256 as text */
#define QUEUE_NOT_HELD INT64_C(-1)

/* What a user has to do with an uploaded file. The queue also has a row of the file itself, whose user is "". */
typedef struct queue_upload {
    char hash[QUEUE_HASH_SIZE], user[QUEUE_HASH_SIZE]; /* SHA-256 of the file, and of the user's name */
    int64_t bytes;                                     /* length of the file */
    int64_t sent_ms; /* since when the user holds the file, wall clock; or QUEUE_NOT_HELD */
    char *name;      /* that the user gave it; NULL: none, and in lists */
} queue_upload;

/* Since when the user holds the file, or QUEUE_NOT_HELD, and the name that it gave the file, to be freed. */
bool queue_find_upload(queue *q, const char *hash, const char *user, int64_t *sent_ms, char **name, error *e);
/* Whether no unfinished job reads the file and it has expired (is_over) or all users have released it. A file without
 * rows, of a database that was lost, is not released. */
bool queue_may_remove_upload(queue *q, const char *hash, bool is_over, bool *may, error *e);
/* Lists what a user holds after the row `after`: sent last first, then by hash; or (`user` NULL) all rows by hash and user.
 * The caller frees the list, also on failure. */
bool queue_list_uploads(queue *q, const char *user, const queue_upload *after, int limit,
                        queue_upload **uploads, size_t *count, error *e);

/* Stores at most DATABASE_PIECE_ROWS rows. The time of a hold stays; the name is replaced unless it is NULL. *added: the
 * number of new holds. */
bool queue_hold_uploads(queue *q, const queue_upload *uploads, size_t count, size_t *added, error *e);

typedef enum queue_forgetting {
    QUEUE_FORGET_FILE,  /* all rows of each hash */
    QUEUE_FORGET_HOLDS, /* no user holds the file any more; the names stay */
    QUEUE_FORGET_USER   /* the row of hash and user */
} queue_forgetting;

/* Forgets uploads, in pieces. *ended, which the caller frees, has the rows of the holds that it ended, also on failure. */
bool queue_forget_uploads(queue *q, queue_forgetting what, const queue_upload *uploads, size_t count,
                          queue_upload **ended, size_t *ended_count, error *e);

/* ---- disk space of results */

typedef struct queue_sum {
    int64_t bytes, results;
} queue_sum;

/* Bounds on the disk space of ended jobs: results and logs. Every task that succeeded, failed or timed out
 * counts as a result. While a bound on all results is reached, no task is started; while a bound on a user's
 * results is reached, none of that user. Running tasks may exceed a bound. */
typedef struct queue_bounds {
    queue_sum all, user; /* INT64_MAX: none */
    bool undelivered;    /* jobs with undelivered results may also be deleted, after all others */
} queue_bounds;

/* Sets the bounds; initially there are none. Call it before other threads use the queue. */
void queue_bound(queue *q, const queue_bounds *bounds);

/* The job to delete next if a bound is reached: of the jobs whose results were all delivered, the one with
 * the earliest delivery. A job without results counts as delivered when it ends. */
bool queue_next_leaving(queue *q, char id[ULID_SIZE], bool *found, error *e);

/* Records that the owner received the whole result of this task. Changes nothing if that is known or there is
 * no result. */
bool queue_note_delivery(queue *q, const char *id, int frame, int64_t wall_ms, error *e);

/* An ended job with unknown disk space: an older version ran it, or it was adopted. */
bool queue_next_unmeasured(queue *q, char id[ULID_SIZE], bool *found, error *e);
bool queue_note_bytes(queue *q, const char *id, int64_t bytes, error *e);

typedef struct queue_user_sum {
    char name[QUEUE_OWNER_SIZE];
    queue_sum sum;
} queue_user_sum;

typedef struct queue_usage {
    queue_bounds bounds;
    queue_sum all;
    bool full;            /* a bound on all results is reached, and no job may be deleted */
    queue_user_sum *user; /* sorted by decreasing space; to be freed */
    size_t count;
} queue_usage;

bool queue_get_usage(queue *q, queue_usage *usage, error *e);

/* ---- webhooks */

/* The notification of the end of a job with a webhook. The transaction that ends the job adds it to the
 * outbox. */
typedef struct queue_delivery {
    int64_t number;        /* number in this outbox */
    char event[ULID_SIZE]; /* unique random id of this end of the job */
    char id[ULID_SIZE];    /* of the job */
    char *name;            /* of the job; NULL: none */
    char *labels;          /* a JSON array of strings */
    char *trace;           /* traceparent; NULL: none */
    char *url;
    int64_t ended_ms;
    queue_state state;
    queue_outcome outcome;
    char *copy_state, *copy_code, *copy_message; /* see queue_job */
    int tries;                                   /* number of failed tries */
    int64_t due_ms;                              /* earliest time of the next try, wall clock */
} queue_delivery;

void queue_delivery_clear(queue_delivery *delivery);

/* The delivery with the earliest due time, possibly in the future. It remains in the outbox until
 * queue_end_delivery. Deliveries whose URL starts with an item of `but`, a JSON array of texts, are skipped.
 * An item for one host ends with the slash after the host. */
bool queue_next_delivery(queue *q, const char *but, queue_delivery *delivery, bool *found, error *e);

/* Removes a delivery that was made or abandoned. With wait_ms > 0 it is tried again after this time
 * instead, even if the wall clock is set meanwhile. */
bool queue_end_delivery(queue *q, int64_t number, int64_t wait_ms, error *e);

/* ---- waiting for changes */

/* Stored changes and queue_signal wake the task, whose next step then misses no event. Call it before other
 * threads use the queue. */
void queue_wake_on_change(queue *q, runner_task *t);
void queue_wake_no_more(queue *q, const runner_task *t);
void queue_signal(queue *q);

#endif
