/* queue: the durable store of jobs, their tasks and attempts, and their events.
 *
 * One process owns the database. It holds a lock on the state directory, and a lock on the database keeps other
 * programs out. One connection writes; others read and wait for no change (database/database.h). Any thread may call any function. When a function returns true, its change is
 * on disk (WAL, synchronous=FULL). Changes that threads make at the same time share one transaction and one flush. No
 * reader sees a change before it is durable. When the database fails, the error has the code internal and no output is
 * written. The log tells when changes begin to fail and when they succeed again.
 *
 * A job has one task, or one task per frame. A task is tried by attempts. Every claim of a task raises its attempt
 * number. This number is a fence: the queue rejects what an older attempt reports. `spent` counts the attempts that
 * count against max_attempts. An attempt that the service itself put back does not count.
 *
 * The state of a job follows from its tasks and from the commands it was given. It is updated in the transaction that
 * changes them:
 *     queued      waits for a claim; between two frames a job stays running
 *     blocked     waits for the jobs that it depends on
 *     paused      no attempt is started until the job is resumed; while earlier attempts still run, the job is running
 *     running     an attempt runs
 *     cancelling  an attempt runs and was asked to end
 *     succeeded, failed, timed_out, cancelled: every task has ended. When tasks ended differently, the job takes the
 *                 first of failed, timed_out, cancelled. A job that was cancelled is cancelled.
 * A task is queued, running, or in a final state. Only a retry leaves a final state.
 */
#ifndef HEXAD_QUEUE_QUEUE_H
#define HEXAD_QUEUE_QUEUE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/running_time.h"
#include "database/health.h"
#include "base/ulid.h"
#include "queue/user_numbers.h"

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

/* From good to bad. doc/report.md defines them. */
typedef enum queue_outcome {
    QUEUE_NO_OUTCOME,
    QUEUE_CONVERGED,
    QUEUE_UNRESOLVED,
    QUEUE_NOT_CONVERGED
} queue_outcome;

const char *queue_state_name(queue_state state); /* "queued", ... */
bool queue_state_from_name(const char *name, queue_state *state);
bool queue_state_is_final(queue_state state);
const char *queue_outcome_name(queue_outcome outcome);   /* NULL for no outcome */
queue_outcome queue_outcome_from_name(const char *name); /* QUEUE_NO_OUTCOME for NULL and other words */

/* Opens or creates the queue in an existing directory. Fails when another process holds the directory (the message says
 * so), when it is on a network file system, or when a newer version of the program created the database. */
queue *queue_open(const char *state_dir, error *e);
/* Opens a copy of a database (database/backup) for reading. An older version is migrated first, in the copy. */
queue *queue_open_copy(const char *path, error *e);
void queue_close(queue *q); /* accepts NULL */

/* For backups and checks of the database (database/backup, database/checker). */
struct database *queue_database(queue *q);

/* Reserves `bytes` of disk space for the database, so that jobs can still be cancelled, deleted and ended when the disk
 * is full. New jobs are then accepted only while the same amount is free in addition. 0: no reserve. When the space
 * cannot be reserved, a warning is logged. */
void queue_reserve(queue *q, int64_t bytes);

/* The service instance that the database belongs to (results/instance.h), and the boot of the host in which the daemon
 * ran last. */
typedef struct queue_instance {
    char id[ULID_SIZE]; /* "": the database comes from a version without instance ids */
    char boot_id[40];   /* "": not known */
} queue_instance;

/* *found is false when the database is new. */
bool queue_get_instance(queue *q, queue_instance *instance, bool *found, error *e);
bool queue_set_instance(queue *q, const queue_instance *instance, error *e);

/* ---- health */

void queue_get_health(queue *q, health_report *known);

/* False when the database is damaged. The error tells what is damaged and what an operator has to do. */
bool queue_allows_changes(queue *q, error *e);

/* ---- jobs */

typedef struct queue_counts { /* tasks; the sum of all but `all` is `all` */
    int all, waiting, running, succeeded, failed, cancelled, timed_out;
} queue_counts;

#define QUEUE_NO_FRAME INT32_MIN

typedef struct queue_job {
    char id[ULID_SIZE];
    int64_t seq;      /* order of arrival */
    uint64_t stamp;   /* of queue_get: see queue_stamp; or QUEUE_NO_STAMP */
    int64_t revision; /* raised by every change of a member of this struct */
    char *name;       /* NULL: none */
    char *owner;      /* the user; "": unknown */
    char *labels;     /* a JSON array of strings */
    char *trace;      /* traceparent; NULL: none */
    char *spec;       /* opaque to the queue; NULL in a listing */
    char *paths;      /* as the submission's; NULL in a listing */
    queue_state state;
    queue_outcome outcome; /* the worst of its tasks */
    bool paused;
    bool array; /* has a task per frame */
    queue_counts tasks;
    int attempts; /* of all tasks */
    int priority; /* higher runs first */
    int max_attempts;
    int threads;                                 /* of an attempt */
    int64_t memory_mb;                           /* of an attempt */
    int64_t created_ms, started_ms, finished_ms; /* wall clock; 0: not yet */
    int64_t retention_s;                         /* after its end; 0: for ever */
    char *error_code, *error_message;            /* NULL: none */
    char *cached_from; /* the job whose result was reused; NULL: this job computed its own */
    char *copy_state; /* of the copy to its directory: delivered, failed, pending; NULL: none was tried yet */
    char *copy_code, *copy_message; /* with failed */
} queue_job;

void queue_job_clear(queue_job *job); /* frees what it holds; accepts an empty one */
void queue_jobs_free(queue_job *jobs, size_t count);

typedef struct queue_submission {
    const char *name;   /* may be NULL */
    const char *owner;  /* NULL: "" */
    const char *labels; /* a JSON array of strings */
    const char *trace;  /* may be NULL */
    const char *spec;
    const char *paths; /* opaque: the paths of the spec as the client wrote them; may be NULL */
    int priority, max_attempts, threads;
    int64_t memory_mb, retention_s;
    const int *frames; /* a task for each, in this order, none twice; NULL: one task */
    size_t frame_count;
    /* The tasks run one after the other, and each begins with the result of the task before. A task that does not
     * succeed ends the later ones. One that fails with no_surface is skipped instead. */
    bool ordered;
    const char *const *depends_on; /* ids of jobs that have to succeed before this one starts */
    size_t depends_on_count;
    const char *const *after; /* ids of jobs that have to end before */
    size_t after_count;
    const char *const *inputs; /* names of the uploaded files that it reads */
    size_t input_count;
    int64_t timeout_ms, stall_ms; /* of an attempt; 0: the service's own */
    const char *directory;        /* takes a copy of the results, see frames_path; NULL: no copy */
    const char *cache_key;        /* jobs with the same key have the same result; NULL: it is not reused */
    const char *webhook;          /* a URL that is notified of the job's end; may be NULL */
    const char *key, *body_hash;  /* idempotency: both or none; each owner has keys of its own */
    int64_t most_waiting;         /* how many unfinished jobs the owner may have; 0: any number */
} queue_submission;

typedef enum queue_verdict {
    QUEUE_CREATED,
    QUEUE_REPLAYED,          /* the key was seen with this body: the receipt names that job */
    QUEUE_MISMATCH,          /* the key was seen with another body, for the job in the receipt */
    QUEUE_TOO_MANY,          /* the owner has most_waiting jobs already */
    QUEUE_RESULTS_FULL,      /* a bound of all results is met and none may be deleted (queue_bounds) */
    QUEUE_USER_RESULTS_FULL, /* one of the owner's */
    QUEUE_NO_ROOM,           /* the disk has less free than queue_reserve has set aside */
    QUEUE_UNKNOWN_DEPENDENCY /* the receipt says which of depends_on, or behind these of after */
} queue_verdict;

typedef struct queue_receipt {
    queue_verdict verdict;
    char id[ULID_SIZE];
    queue_state state; /* queued, blocked, or failed: a job that it depends on has failed already */
    int64_t revision;
    size_t dependency;
} queue_receipt;

/* Stores the job if the verdict is QUEUE_CREATED, and nothing otherwise. */
bool queue_put(queue *q, const queue_submission *submission, queue_receipt *receipt, error *e);

/* Whether the owner has used this idempotency key. */
bool queue_has_key(queue *q, const char *owner, const char *key, bool *found, error *e);

/* *found is false when there is no such job. The caller clears *job. */
bool queue_get(queue *q, const char *id, queue_job *job, bool *found, error *e);

/* A number that changes with every change of the job `seq` or of its attempts, and sometimes with a change of another
 * job. While it equals the stamp that queue_get returned, that job is still up to date. A change raises it before the function that
 * made the change returns. Does not read the database. */
#define QUEUE_NO_STAMP UINT64_MAX /* the job may have changed while it was read; no job has this stamp */
uint64_t queue_stamp(queue *q, int64_t seq);

/* What a list is sorted by: the job's place in the queue, its name (without regard to the case of ASCII letters, the
 * nameless first), its owner, the word for its state, its priority. Jobs that are alike in that are sorted by their place. */
typedef enum queue_order {
    QUEUE_BY_AGE,
    QUEUE_BY_NAME,
    QUEUE_BY_OWNER,
    QUEUE_BY_STATE,
    QUEUE_BY_PRIORITY
} queue_order;
#define QUEUE_ORDER_COUNT 5

typedef struct queue_filter {
    int state;                        /* a queue_state, or -1: any */
    unsigned states;                  /* of several: a bit for each queue_state; 0: as `state` says */
    const char *owner, *label, *name; /* NULL: any */
    const char *needs;                /* the id of a job that it depends on (depends_on, after); NULL: any */
    const char *text;                 /* a part of the name, whatever the case of ASCII letters; NULL: any */
    int64_t since_ms, until_ms;       /* created at this time or later, and before this time; 0: any */
    queue_order order;
    bool rising;           /* smallest or oldest first */
    int64_t after_seq;     /* only jobs behind this one in the list; 0: all */
    const char *after_key; /* what queue_sort_key said of that job; not needed BY_AGE */
    int limit;
} queue_filter;

/* Where a list continues: what queue_sort_key says of the job there (NULL: BY_AGE), and its place in the queue. */
typedef struct queue_place {
    int64_t seq; /* 0: nowhere */
    char *key;
} queue_place;

typedef struct queue_page {
    queue_job *jobs; /* without their specs */
    size_t count;
    queue_place stop; /* the last job that was visited; seq 0: the walk ended before, or at the limit */
} queue_page;

/* A page of a list visits this many jobs at most. */
#define QUEUE_VISITS 4096

/* Lists jobs among the next `visits` of the list (0: among all). Each job that is visited costs a lookup, and each job that is listed a few.
 * When there are more, page->stop is the last of them, whether it is listed or not; the page may be short or empty. */
bool queue_list_page(queue *q, const queue_filter *filter, int visits, queue_page *page, error *e);
void queue_page_clear(queue_page *page);

/* The first jobs of the list, however many are passed over. */
bool queue_list(queue *q, const queue_filter *filter, queue_job **jobs, size_t *count, error *e);

#define QUEUE_SORT_KEY_SIZE 256
/* What a job is sorted by, as text. */
const char *queue_sort_key(const queue_job *job, queue_order order, char text[QUEUE_SORT_KEY_SIZE]);
/* Negative when `a` stands before `b` in the list of the filter. */
int queue_compare(const queue_job *a, const queue_job *b, const queue_filter *filter);

/* Whether a job that has not ended reads the file of this name. */
bool queue_wants_input(queue *q, const char *name, bool *wanted, error *e);

/* How many jobs are in each state. */
bool queue_count(queue *q, int64_t count[QUEUE_STATE_COUNT], error *e);

typedef struct queue_figures {
    int64_t
        waiting_since_ms; /* wall clock: since when the first of the queued jobs waits; 0: none is queued */
    int64_t deliveries;   /* of webhooks that are still to be made */
    int64_t delivery_since_ms; /* wall clock: the end that the first of them tells of; 0: there is none */
    int64_t undelivered; /* jobs with results that were neither copied to output.directory nor downloaded */
    int64_t database_bytes;
} queue_figures;

/* Costs a few lookups, however many jobs there are, and a walk over the deliveries and the undelivered jobs. */
bool queue_get_figures(queue *q, queue_figures *figures, error *e);

typedef enum queue_command {
    QUEUE_CANCEL, /* waiting tasks are cancelled; running ones are asked to end */
    QUEUE_PAUSE,
    QUEUE_RESUME,
    QUEUE_RETRY, /* of a job that has ended: its tasks without success are queued again, with all their
                  * attempts to spend */
    QUEUE_DELIVER /* of a job that has ended and names a directory: its results are to be copied there again, or those of
                   * the tasks whose copies have failed (queue_next_uncopied) */
} queue_command;

/* *now is the state afterwards. *changed is false when the command does not apply, as a cancellation of a job that has
 * ended, or a retry of a job that depends on a failed one. */
bool queue_tell(queue *q, const char *id, queue_command command, bool *found, bool *changed, queue_state *now,
                error *e);

typedef struct queue_retried {
    size_t count;              /* of jobs that were retried */
    char (*others)[ULID_SIZE]; /* those that were not, in the order of their arrival; to be freed */
    size_t other_count;
} queue_retried;

/* Retries, in one change, the jobs that ended as dependency_failed because of this one, and those behind them in turn.
 * Others are those of another owner than `owner` (NULL: any owner will do) and those that still depend on a job that has
 * failed. */
bool queue_retry_dependents(queue *q, const char *id, const char *owner, queue_retried *retried, error *e);

typedef struct queue_edit {
    const int *priority;        /* NULL: stays */
    const char *labels;         /* NULL: stay */
    const int64_t *retention_s; /* NULL: stays; counts from the job's end, also of one that has ended */
} queue_edit;

typedef enum queue_edited { QUEUE_EDITED, QUEUE_NOT_THERE, QUEUE_STALE } queue_edited;

/* When the job has another revision than `revision` (-1: any), nothing changes and *edited is QUEUE_STALE. */
bool queue_change(queue *q, const char *id, int64_t revision, const queue_edit *edit, queue_edited *edited,
                  error *e);

/* Deletes a job that has ended from the queue, and notes its directories for removal (see queue_removal). *deleted is
 * false when the job has not ended. */
bool queue_delete(queue *q, const char *id, bool *found, bool *deleted, error *e);

/* The ids of at most `limit` jobs whose retention is over by one of these bounds, in one array to be freed. */
bool queue_list_expired(queue *q, const running_bound *bounds, size_t bound_count, int limit,
                        char (**ids)[ULID_SIZE], size_t *count, error *e);
/* When the next retention after `after_ms` is over, both by the wall clock; INT64_MAX: never. */
bool queue_next_expiry(queue *q, int64_t after_ms, int64_t *wall_ms, error *e);

/* How long the daemon has run: the periods that were stored last, and the one that began with queue_open. The caller
 * stores them with queue_store_running now and then; what is not stored does not count after a crash. */
running_time *queue_running(queue *q);
bool queue_store_running(queue *q, error *e);

/* ---- tasks and attempts */

typedef struct queue_task {
    int number;        /* 0, 1, ... in the job */
    int frame;         /* QUEUE_NO_FRAME: the job is no array */
    queue_state state; /* queued, running or final */
    queue_outcome outcome;
    int attempt;           /* number of the last claim; 0: none */
    int spent;             /* attempts that count */
    int storage_faults;    /* attempts that do not count, because a disk was full or failed */
    int interrupted;       /* attempts that ended because the daemon or its host did */
    int64_t ran_ms;        /* running time of the attempts that count and were put back */
    int64_t not_before_ms; /* queued: no attempt before; 0: at once */
    int64_t started_ms, finished_ms;
    char *error_code, *error_message; /* NULL: none */
} queue_task;

void queue_task_clear(queue_task *task);
void queue_tasks_free(queue_task *tasks, size_t count);

/* Tasks in the order of their numbers, from the one behind `after` (-1: all). The list is empty when there is no such
 * job. */
bool queue_list_tasks(queue *q, const char *id, int after, int limit, queue_task **tasks, size_t *count,
                      error *e);
bool queue_get_frame(queue *q, const char *id, int frame, queue_task *task, bool *found, error *e);

typedef struct queue_attempt {
    int task, frame, number;
    int64_t started_ms, finished_ms; /* 0: runs */
    int exit_status, signal;         /* -1: none */
    int64_t peak_memory_bytes;
    int64_t waited_ms, processor_ms; /* 0: not known, or none */
    char *host;                      /* where it ran; may be NULL */
    char *reason;                    /* may be NULL */
} queue_attempt;

/* Sorted by task and number, from the one behind attempt `after` of the task `after_task` (-1: all). The list is empty
 * when there is no such job. */
bool queue_list_attempts(queue *q, const char *id, int after_task, int after, int limit,
                         queue_attempt **attempts, size_t *count, error *e);
void queue_attempts_free(queue_attempt *attempts, size_t count);

/* ---- running */

typedef struct queue_claimed {
    queue_job job;
    queue_task task;
    int64_t timeout_ms, stall_ms; /* these and the next: as in the submission */
    char *directory, *cache_key;
    char **inputs;
    size_t input_count;
    int previous; /* of an ordered job: the last earlier frame that has succeeded; QUEUE_NO_FRAME: none */
} queue_claimed;

void queue_claimed_clear(queue_claimed *claimed);
void queue_claimed_free(queue_claimed *claimed, size_t count);

/* What is free on this host, and what there is in all. A job that asks for more threads than there are gets all of
 * them. A job that asks for more memory than there is gets claimed at once, so that the executor can fail it. */
typedef struct queue_room {
    int threads, all_threads;
    int64_t memory_mb, all_memory_mb;
    int most_of_owner;           /* tasks of one owner that may run at once; 0: any number */
    const user_numbers *weights; /* turns of an owner, in relation to others; NULL: 1 for each */
} queue_room;

/* How many later claims may overtake a job that does not fit at the moment. After that all others wait for it. */
#define QUEUE_OVERTAKE_MOST 16

/* Claims a task of a job with the highest priority that fits into the room. Owners of such jobs take turns; of the jobs
 * of one owner the oldest comes first. The task becomes running under a new attempt number. *found is false when no task
 * may run now. */
bool queue_claim(queue *q, const queue_room *room, queue_claimed *claimed, bool *found, error *e);

/* Claims the first queued task of one job, whatever the room. */
bool queue_claim_job(queue *q, const char *id, queue_claimed *claimed, bool *found, error *e);

/* While the queue is held, queue_claim finds nothing. Lasts until it is released, also over a restart. */
bool queue_hold(queue *q, bool on, error *e);
bool queue_is_held(queue *q, bool *held, error *e);

/* After the wall clock was set back: no delayed task and no notification waits longer, from now on, than it had to wait
 * when its last try ended. */
bool queue_shorten_waits(queue *q, error *e);

/* When the next delayed task may be tried again, wall clock; INT64_MAX: there is none. */
bool queue_next_due(queue *q, int64_t *wall_ms, error *e);

/* Tasks that the queue holds as running. At a start these are the ones that a crash left. Oldest first. */
bool queue_list_unsettled(queue *q, queue_claimed **claimed, size_t *count, error *e);

/* How an attempt ended. */
typedef struct queue_ending {
    queue_state state; /* final; for queue_finish */
    queue_outcome outcome;
    const char *error_code, *error_message; /* may be NULL */
    int exit_status, signal;                /* -1: not known or none */
    int64_t peak_memory_bytes;              /* 0: not known */
    int64_t waited_ms;                      /* in the queue of a farm, before its worker began; likewise */
    int64_t processor_ms;                   /* of its worker; likewise */
    int64_t ran_ms;                         /* likewise; for queue_requeue */
    bool interrupted;                       /* for queue_requeue: by the end of the daemon or of its host */
    const char *host;                       /* may be NULL */
    const char *reason;                     /* one line for the attempt's record; may be NULL */
    const char *cached_from;                /* the job whose result was reused; may be NULL */
    bool storage_fault;                     /* for queue_requeue: a disk was full or failed */
    int64_t bytes;                          /* that the attempt leaves on the disk */
    bool delivered;                         /* for queue_finish: the result was copied to output.directory */
    bool copy_pending;                      /* likewise: it has to be copied, see queue_next_uncopied */
    const char *copy_code, *copy_message;   /* likewise: it could not be copied; may be NULL */
    const char *copied;                     /* a name of queue_note_copy to be forgotten; may be NULL */
    const char *cache_key,
        *cache_inputs; /* both or none: the result may be reused by other jobs, see queue_recall */
} queue_ending;

/* Names one attempt. */
typedef struct queue_fence {
    const char *id;
    int task, attempt;
} queue_fence;

/* Ends a task. When the attempt is not the current one or the task does not run, nothing changes and *accepted is
 * false. */
bool queue_finish(queue *q, const queue_fence *fence, const queue_ending *ending, bool *accepted, error *e);

/* Queues a running task again. `counts` tells whether the attempt counts against max_attempts, and its time against the
 * time limit. The next attempt starts at `not_before_ms` (wall clock; 0: at once) or later. *accepted as above; it is
 * also false when the job is cancelling. */
bool queue_requeue(queue *q, const queue_fence *fence, bool counts, int64_t not_before_ms,
                   const queue_ending *ending, bool *accepted, error *e);

/* Finds the job whose result was stored last under this key, and the inputs that were stored with it, to be freed. */
bool queue_recall(queue *q, const char *key, char id[ULID_SIZE], char **inputs, bool *found, error *e);

/* A job that has succeeded with the result of another job. */
typedef struct queue_reused {
    int64_t seq;
    char id[ULID_SIZE], from[ULID_SIZE];
    char *spec;
} queue_reused;

void queue_reused_free(queue_reused *jobs, size_t count);

/* Lists such jobs with a seq above `after`. Looks at all jobs. */
bool queue_list_reused(queue *q, int64_t after, int limit, queue_reused **jobs, size_t *count, error *e);

/* Whether reports of such jobs may be hard links, because an earlier version made them (results/own_report). */
bool queue_has_linked_reports(queue *q, bool *has, error *e);
bool queue_note_own_reports(queue *q, error *e);

/* ---- temporary files of copies of results, in output directories */

typedef struct queue_copy {
    char *directory, *name;
} queue_copy;

void queue_copies_free(queue_copy *copies, size_t count);

/* Notes that a temporary file of this name may be created in the directory. A name is used once. Also notes that the
 * report in that directory, whose path without links is `output`, is the owner's from now on. */
bool queue_note_copy(queue *q, const char *directory, const char *name, const char *output, const char *owner,
                     error *e);
/* The user for whom the last report was delivered into this directory, to be freed; NULL: none is known. */
bool queue_get_output_owner(queue *q, const char *output, char **owner, error *e);
bool queue_forget_copy(queue *q, const char *name, error *e);
bool queue_list_copies(queue *q, queue_copy **copies, size_t *count, error *e);

/* An ended job whose results are to be copied to its directory. */
typedef struct queue_uncopied {
    int64_t seq;
    char id[ULID_SIZE];
    char *owner, *directory;
    queue_task *tasks; /* number and frame are set */
    size_t count;
} queue_uncopied;

void queue_uncopied_clear(queue_uncopied *job);

/* The first such job (QUEUE_DELIVER, queue_ending.copy_pending) with a seq above `after`. */
bool queue_next_uncopied(queue *q, int64_t after, queue_uncopied *job, bool *found, error *e);
/* Notes that the result of a task was copied, or (`fault` not NULL) why not, and forgets the note of the copy `name`. */
bool queue_note_copied(queue *q, const char *id, const queue_task *task, const error *fault, const char *name,
                       error *e);
/* All tasks of the job were tried. */
bool queue_end_copying(queue *q, const char *id, error *e);

/* ---- events */

typedef enum queue_event_type {
    QUEUE_EVENT_STATE,   /* the job is in `state` now */
    QUEUE_EVENT_TASK,    /* a task of an array is in `state` now */
    QUEUE_EVENT_STARTED, /* an attempt was claimed */
    QUEUE_EVENT_ENDED,   /* an attempt has ended; queue_list_attempts says how */
    QUEUE_EVENT_EDITED, /* priority, labels or retention; or it was paused or resumed without another state */
    QUEUE_EVENT_TYPE_COUNT
} queue_event_type;

const char *queue_event_type_name(queue_event_type type); /* "state", ... */

#define QUEUE_OWNER_SIZE 65

typedef struct queue_event {
    int64_t seq; /* one rising sequence for all jobs; no number is used twice */
    int64_t at_ms;
    char id[ULID_SIZE];           /* of the job */
    char owner[QUEUE_OWNER_SIZE]; /* of the job */
    queue_event_type type;
    queue_state state;     /* of the job, or of the task */
    queue_outcome outcome; /* with a final state */
    int frame;             /* QUEUE_NO_FRAME: none */
    int attempt;           /* 0: none */
} queue_event;

/* A value of `after_seq`: only events from now on. */
#define QUEUE_EVENTS_FROM_NOW (-1)

typedef struct queue_event_filter {
    const char *id, *owner, *label; /* NULL: any; the job must have the label now */
    int64_t after_seq;
    int limit;
} queue_event_filter;

typedef struct queue_event_page {
    queue_event *events; /* oldest first, to be freed */
    size_t count;
    int64_t position; /* the next page begins here: all events up to this number were looked at */
    bool more;        /* there may be more events now: the page is full, or the bound was reached */
    int64_t newest;   /* the highest number so far; a page behind it is empty, with this position */
    /* Some events up to this number were removed, together with their jobs. 0: none were, or the page is of one job,
     * whose events are removed together. */
    int64_t removed_up_to;
} queue_event_page;

/* Looks at a bounded number of events in the order of their numbers (with a job id: only at those of that job). So a
 * page may be empty although more events follow. The events of a job are deleted with it. */
bool queue_list_events(queue *q, const queue_event_filter *filter, queue_event_page *page, error *e);

/* ---- directories of tasks: those to be removed, and those found at a start */

/* A deleted task, whose result and attempts 1 .. `attempts` are to be removed. The transaction that deletes the job
 * notes it. Results are removed because of such a note, and for no other reason. */
typedef struct queue_removal {
    int64_t number; /* rises */
    char id[ULID_SIZE];
    int frame, attempts;
} queue_removal;

/* Lists removals with numbers above `after`, of one job or (id NULL) of all jobs. To be freed. */
bool queue_list_removals(queue *q, const char *id, int64_t after, int limit, queue_removal **removals,
                         size_t *count, error *e);
/* Deletes the notes, after the directories were removed. */
bool queue_end_removals(queue *q, const queue_removal *removals, size_t count, error *e);

/* A directory that belongs to a task by its name, and what the queue knows of that task. */
typedef struct queue_directory {
    char id[ULID_SIZE];
    int frame;
    int attempt;        /* 0: a result */
    bool to_be_removed; /* see queue_removal */
    bool known;         /* the task is there: */
    queue_state state;  /* queued, running or final */
    int last_attempt;
} queue_directory;

/* Fills in what the queue knows. Costs one index lookup per directory. */
bool queue_find_directories(queue *q, queue_directory *directories, size_t count, error *e);

/* Ends a waiting task whose result was found: the database is older than the result. *accepted is false when the task
 * does not wait. */
bool queue_end_found(queue *q, const char *id, int frame, queue_outcome outcome, bool *accepted, error *e);

/* A job that is not in the queue, as its results describe it. It has succeeded. */
typedef struct queue_adopted_task {
    int frame; /* QUEUE_NO_FRAME: the only task */
    queue_outcome outcome;
    int64_t finished_ms;
} queue_adopted_task;

typedef struct queue_adoption {
    char id[ULID_SIZE];
    const char *name;   /* may be NULL */
    const char *labels; /* a JSON array of strings */
    const char *spec;
    int priority, max_attempts, threads;
    int64_t memory_mb;
    queue_adopted_task *tasks;
    size_t task_count;
} queue_adoption;

/* Puts the jobs into the queue, all or none. Their owner is "" and they are kept until somebody deletes them. */
bool queue_adopt(queue *q, const queue_adoption *jobs, size_t count, error *e);

/* ---- the space that results take */

typedef struct queue_sum {
    int64_t bytes, results;
} queue_sum;

/* Bounds of what ended jobs leave: files of results, and logs. Every task that succeeded, failed or timed out counts as a
 * result. While a bound of all is met, no task is started; while one of a user is met, none of his. What runs then may
 * exceed it. */
typedef struct queue_bounds {
    queue_sum all, user; /* INT64_MAX: none */
    bool undelivered;    /* jobs whose results nobody got may be deleted, too, after all others */
} queue_bounds;

/* Without it there are no bounds. Call it before other threads use the queue. */
void queue_bound(queue *q, const queue_bounds *bounds);

/* The job to be deleted next, because a bound is met: of those whose results were all delivered, the one for which that
 * was longest ago. A job without results counts as delivered when it ends. */
bool queue_next_leaving(queue *q, char id[ULID_SIZE], bool *found, error *e);

/* The owner has got the whole result of this task. Changes nothing when that is known or there is no result. */
bool queue_note_delivery(queue *q, const char *id, int frame, int64_t wall_ms, error *e);

/* An ended job whose bytes are not known: an older version ran it, or it was adopted. */
bool queue_next_unmeasured(queue *q, char id[ULID_SIZE], bool *found, error *e);
bool queue_note_bytes(queue *q, const char *id, int64_t bytes, error *e);

typedef struct queue_user_sum {
    char name[QUEUE_OWNER_SIZE];
    queue_sum sum;
} queue_user_sum;

typedef struct queue_usage {
    queue_bounds bounds;
    queue_sum all;
    bool full;            /* a bound of all is met, and no job may be deleted */
    queue_user_sum *user; /* who has most comes first; to be freed */
    size_t count;
} queue_usage;

bool queue_get_usage(queue *q, queue_usage *usage, error *e);

/* ---- webhooks */

/* The notification that a job with a webhook has ended. The transaction that ends the job puts it into the outbox. */
typedef struct queue_delivery {
    int64_t number;        /* in this outbox */
    char event[ULID_SIZE]; /* a random id of this end of the job, which no other queue gives */
    char id[ULID_SIZE];    /* of the job */
    char *name;            /* of the job; NULL: none */
    char *labels;          /* a JSON array of strings */
    char *trace;           /* traceparent; NULL: none */
    char *url;
    int64_t ended_ms;
    queue_state state;
    queue_outcome outcome;
    char *copy_state, *copy_code, *copy_message; /* as queue_job's */
    int tries;                                   /* that failed */
    int64_t due_ms;                              /* the earliest time of the next try, wall clock */
} queue_delivery;

void queue_delivery_clear(queue_delivery *delivery);

/* The delivery that is due first, possibly in the future. It stays in the outbox until queue_end_delivery. Deliveries
 * whose URL begins with an item of `but`, a JSON array of texts, are skipped. An item that means one host ends with the
 * slash behind the host. */
bool queue_next_delivery(queue *q, const char *but, queue_delivery *delivery, bool *found, error *e);

/* Removes a delivery that was made or given up. With again_ms > 0 it is tried again at that time instead. */
bool queue_end_delivery(queue *q, int64_t number, int64_t again_ms, error *e);

/* ---- waiting for changes */

/* Waits until changes were stored or queue_signal was called since *seen (0 at first), or until the deadline
 * (monotonic). Returns true and updates *seen when something happened. A caller that waits first and lists afterwards
 * misses no event. */
bool queue_wait(queue *q, uint64_t *seen, int64_t until_ms);
void queue_signal(queue *q);

#endif
