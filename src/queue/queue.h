/* queue: jobs, their tasks and attempts, and the record of what happened to them, durable. The only
 * user of SQLite.
 *
 * One process owns the database (a lock on the state directory says so, and SQLite's exclusive
 * locking keeps other programs out) over one connection. Any thread may call any function. A function
 * that returns true has its change on disk (WAL, synchronous=FULL); changes that threads make at
 * the same time share one transaction and its flush, and nobody sees a change before it is durable.
 * Database trouble is an error with code internal; outputs are then untouched. That changes cannot
 * be stored is logged, when it begins and when it ends.
 *
 * A job has one task, or one for each frame. A task is tried by attempts. Every claim of a task raises its
 * attempt number, which is a fence: what an older attempt reports is not accepted. `spent` counts
 * the attempts that weigh against max_attempts; one that the service itself gave back does not.
 *
 * The state of a job follows from its tasks and from what was asked of it, always in the transaction
 * that changes them:
 *     queued      waits for its turn; between two frames a job stays running
 *     blocked     waits for the jobs that it depends on
 *     paused      starts no attempt until it is resumed; what runs goes on, and the job is running meanwhile
 *     running     an attempt runs
 *     cancelling  an attempt runs and is to end
 *     succeeded, failed, timed_out, cancelled: every task has ended. Of different ends the first of
 *                 failed, timed_out, cancelled counts; a job that was cancelled is cancelled.
 * A task is queued, running, or has ended. Final states are left by a retry only.
 */
#ifndef HEXAD_QUEUE_QUEUE_H
#define HEXAD_QUEUE_QUEUE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "queue/ulid.h"

typedef struct queue queue;

/* The database, in the state directory. */
#define QUEUE_FILE_NAME "queue.db"

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

typedef enum queue_outcome { QUEUE_NO_OUTCOME, QUEUE_CONVERGED, QUEUE_NOT_CONVERGED } queue_outcome;

const char *queue_state_name(queue_state state); /* "queued", ... */
bool queue_state_from_name(const char *name, queue_state *state);
bool queue_state_is_final(queue_state state);
const char *queue_outcome_name(queue_outcome outcome); /* NULL for no outcome */

/* Opens or makes the queue in a directory that exists. Fails when another process holds it (the
 * message says so), when it lies on a network file system, or when a newer version of the program made it. */
queue *queue_open(const char *state_dir, error *e);
void queue_close(queue *q); /* accepts NULL */

/* Sets so many bytes of the disk aside for the database, so that jobs can be cancelled, deleted and ended when it is
 * full; jobs are then accepted only while as much is free besides. 0: none. Where the disk cannot do that, or is full
 * already, a warning is logged. */
void queue_reserve(queue *q, int64_t bytes);
/* Whether there is a database that holds anything, so that queue_open does not make a new one. */
bool queue_exists(const char *state_dir);

/* Whose database it is: which instance of the service, in which state directory (executor/instance.h), and which
 * start of the host the daemon ran in last. */
typedef struct queue_instance {
    char id[ULID_SIZE]; /* "": carried over from a version that gave none */
    char boot_id[40];   /* "": not known */
} queue_instance;

/* *found false: of none; the database is new. */
bool queue_get_instance(queue *q, queue_instance *instance, bool *found, error *e);
bool queue_set_instance(queue *q, const queue_instance *instance, error *e);

/* ---- health */

/* Of the database. What is damaged is not written to any more, so that it is not made worse: changes fail with code
 * database_damaged, and reads go on as far as they can. A new start ends that, or, where it was a fault of
 * reading, a check that reads all (queue/checker). */
typedef struct queue_health {
    bool damaged, checking;
    int64_t damaged_ms;    /* wall clock: when it was found */
    const char *found_by;  /* "statement", "copy", "quick_check" or "integrity_check" */
    char damage[240];      /* what was found */
    int64_t checked_ms;    /* wall clock: the end of the last check; 0: there was none */
    int64_t check_took_ms; /* its duration */
} queue_health;

void queue_get_health(queue *q, queue_health *known);

/* False when it is damaged: the error says how, and what an operator has to do. */
bool queue_allows_changes(queue *q, error *e);

/* ---- jobs */

typedef struct queue_counts { /* tasks; the sum of all but `all` is `all` */
    int all, waiting, running, succeeded, failed, cancelled, timed_out;
} queue_counts;

#define QUEUE_NO_FRAME INT32_MIN

typedef struct queue_job {
    char id[ULID_SIZE];
    int64_t seq;      /* order of arrival */
    uint64_t stamp;   /* of queue_get: see queue_stamp */
    int64_t revision; /* raised by every change of what stands here */
    char *name;       /* NULL: none */
    char *owner;      /* the user; "" when nobody is known */
    char *labels;     /* a JSON array of strings */
    char *trace;      /* traceparent; NULL: none */
    char *spec;       /* opaque to the queue; NULL in a listing */
    char *paths;      /* as the submission's; NULL in a listing */
    queue_state state;
    queue_outcome outcome; /* converged when all tasks are */
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
    char *cached_from; /* the job whose result this one was given; NULL: it was run */
} queue_job;

void queue_job_clear(queue_job *job); /* frees what it holds; accepts an empty one */
void queue_jobs_free(queue_job *jobs, size_t count);

typedef struct queue_submission {
    const char *name;   /* may be NULL */
    const char *owner;  /* NULL: "" */
    const char *labels; /* a JSON array of strings */
    const char *trace;  /* may be NULL */
    const char *spec;
    const char *paths; /* opaque: which of the spec's paths were asked for by other names; may be NULL */
    int priority, max_attempts, threads;
    int64_t memory_mb, retention_s;
    const int *frames; /* a task for each, in this order, none twice; NULL: one task */
    size_t frame_count;
    /* The tasks run one after the other, each told of the result before it. One that does not succeed ends
     * those behind it, unless it failed of no_surface: then they do without it. */
    bool ordered;
    const char *const *depends_on; /* ids of jobs */
    size_t depends_on_count;
    const char *const *inputs; /* names of files that it reads and that queue_wants_input is asked for */
    size_t input_count;
    const char *webhook;         /* may be NULL: an address that is told of the job's end */
    const char *key, *body_hash; /* idempotency: both or none; keys of different owners are different */
    int64_t most_waiting;        /* of the owner's jobs that have not ended; 0: any number */
} queue_submission;

typedef enum queue_verdict {
    QUEUE_CREATED,
    QUEUE_REPLAYED,          /* the key was seen with this body: the receipt names that job */
    QUEUE_MISMATCH,          /* the key was seen with another body, for the job in the receipt */
    QUEUE_TOO_MANY,          /* the owner has most_waiting jobs already */
    QUEUE_NO_ROOM,           /* the disk has less free than queue_reserve has set aside */
    QUEUE_UNKNOWN_DEPENDENCY /* the receipt says which of depends_on */
} queue_verdict;

typedef struct queue_receipt {
    queue_verdict verdict;
    char id[ULID_SIZE];
    queue_state state; /* queued, blocked, or failed: a job that it depends on has failed already */
    int64_t revision;
    size_t dependency;
} queue_receipt;

/* Stores a job unless the verdict is another than created. */
bool queue_put(queue *q, const queue_submission *submission, queue_receipt *receipt, error *e);

/* *found false: no such job. The caller clears *job. */
bool queue_get(queue *q, const char *id, queue_job *job, bool *found, error *e);

/* Another number after every change of the job with this seq, and now and then after one of another's: as
 * long as it is what queue_get gave with the job, no change of what that gave has been acknowledged, nor of
 * the job's attempts. Does not look into the database. */
uint64_t queue_stamp(queue *q, int64_t seq);

typedef struct queue_filter {
    int state;                 /* a queue_state, or -1: any */
    const char *owner, *label; /* NULL: any */
    int64_t before_seq;        /* only jobs that came before this one; 0: all */
    int limit;
} queue_filter;

/* Newest first, without their specs. */
bool queue_list(queue *q, const queue_filter *filter, queue_job **jobs, size_t *count, error *e);

/* Whether a job that has not ended reads the file of this name. */
bool queue_wants_input(queue *q, const char *name, bool *wanted, error *e);

/* How many jobs are in each state. */
bool queue_count(queue *q, int64_t count[QUEUE_STATE_COUNT], error *e);

typedef enum queue_command {
    QUEUE_CANCEL, /* tasks that wait are cancelled, those that run are asked to end */
    QUEUE_PAUSE,
    QUEUE_RESUME,
    QUEUE_RETRY /* tasks that have ended without success wait again, with all their attempts; of a job
                 * that has ended */
} queue_command;

/* *now is the state afterwards; *changed whether this call changed anything: it does not where the
 * command makes no sense (cancel of a job that has ended, retry where a job that it depends on failed). */
bool queue_tell(queue *q, const char *id, queue_command command, bool *found, bool *changed, queue_state *now,
                error *e);

typedef struct queue_edit {
    const int *priority;        /* NULL: stays */
    const char *labels;         /* NULL: stay */
    const int64_t *retention_s; /* NULL: stays; counts from the job's end, also of one that has ended */
} queue_edit;

typedef enum queue_edited { QUEUE_EDITED, QUEUE_NOT_THERE, QUEUE_STALE } queue_edited;

/* Stale, and nothing changed, when the job's revision is not `revision`; -1: any. */
bool queue_change(queue *q, const char *id, int64_t revision, const queue_edit *edit, queue_edited *edited,
                  error *e);

/* Forgets a job that has ended, with all that belongs to it, and notes what is to be removed of it (see
 * queue_removal). *deleted false: it has not ended. */
bool queue_delete(queue *q, const char *id, bool *found, bool *deleted, error *e);

/* The ids of at most `limit` jobs whose retention is over, oldest first, in one array to be freed. */
bool queue_list_expired(queue *q, int64_t wall_ms, int limit, char (**ids)[ULID_SIZE], size_t *count,
                        error *e);
/* When the next retention is over, wall clock; INT64_MAX: never. */
bool queue_next_expiry(queue *q, int64_t *wall_ms, error *e);

/* ---- tasks and attempts */

typedef struct queue_task {
    int number;        /* 0, 1, ... in the job */
    int frame;         /* QUEUE_NO_FRAME: the job is no array */
    queue_state state; /* queued, running or final */
    queue_outcome outcome;
    int attempt;           /* number of the last claim; 0: none */
    int spent;             /* attempts that count */
    int storage_faults;    /* attempts that do not, since a disk was full or failed */
    int interrupted;       /* attempts that the end of the daemon or of its host ended */
    int64_t ran_ms;        /* how long those ran that count and were put back */
    int64_t not_before_ms; /* queued: no attempt before; 0: at once */
    int64_t started_ms, finished_ms;
    char *error_code, *error_message; /* NULL: none */
} queue_task;

void queue_task_clear(queue_task *task);
void queue_tasks_free(queue_task *tasks, size_t count);

/* In the order of their numbers, those with numbers above `after` (-1: all). An id that is not there has
 * none. */
bool queue_list_tasks(queue *q, const char *id, int after, int limit, queue_task **tasks, size_t *count,
                      error *e);
bool queue_get_frame(queue *q, const char *id, int frame, queue_task *task, bool *found, error *e);

typedef struct queue_attempt {
    int task, frame, number;
    int64_t started_ms, finished_ms; /* 0: runs */
    int exit_status, signal;         /* -1: none */
    int64_t peak_memory_bytes;
    char *host;   /* where it ran; may be NULL */
    char *reason; /* may be NULL */
} queue_attempt;

/* By task and number. An id that is not there has none. */
bool queue_list_attempts(queue *q, const char *id, queue_attempt **attempts, size_t *count, error *e);
void queue_attempts_free(queue_attempt *attempts, size_t count);

/* ---- running */

typedef struct queue_claimed {
    queue_job job;
    queue_task task;
    int previous; /* of a job in order: the last frame before that has succeeded; QUEUE_NO_FRAME: none */
} queue_claimed;

void queue_claimed_clear(queue_claimed *claimed);
void queue_claimed_free(queue_claimed *claimed, size_t count);

/* What is free, and all there is. A job that asks for more threads than there are gets those; one that
 * asks for more memory is claimed at once, so that it can be told that it will never fit. */
typedef struct queue_room {
    int threads, all_threads;
    int64_t memory_mb, all_memory_mb;
    int most_of_owner; /* tasks of one owner that may run at once; 0: any number */
} queue_room;

/* So many claims may pass by a job that does not fit at the moment; then all wait for it. */
#define QUEUE_OVERTAKE_MOST 16

/* A task of the job of the highest priority, among equals the oldest, that fits into the room,
 * becomes running under a new attempt number. *found false: none may run now. */
bool queue_claim(queue *q, const queue_room *room, queue_claimed *claimed, bool *found, error *e);

/* The first task of one job that is queued, whatever the room. */
bool queue_claim_job(queue *q, const char *id, queue_claimed *claimed, bool *found, error *e);

/* When the next task that waits before it is tried again may be, wall clock; INT64_MAX: there is none. */
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
    int64_t ran_ms;                         /* likewise; for queue_requeue */
    bool interrupted;                       /* for queue_requeue: by the end of the daemon or of its host */
    const char *host;                       /* may be NULL */
    const char *reason;                     /* one line for the attempt's record; may be NULL */
    const char *cached_from;                /* NULL: the attempt made its result itself */
    bool storage_fault;                     /* for queue_requeue: a disk was full or failed */
    const char *copied;                     /* a name of queue_note_copy that is done with; may be NULL */
    const char *cache_key,
        *cache_inputs; /* both or none: the result may be given to others, see queue_recall */
} queue_ending;

/* Which attempt. */
typedef struct queue_fence {
    const char *id;
    int task, attempt;
} queue_fence;

/* Ends a task. *accepted false, and nothing changed, when the attempt is not its current one or the
 * task does not run. */
bool queue_finish(queue *q, const queue_fence *fence, const queue_ending *ending, bool *accepted, error *e);

/* Puts a running task back; `counts` says whether the attempt weighs against max_attempts, and its time
 * against that of the task, and no other attempt starts before `not_before_ms` (wall clock; 0: at once).
 * *accepted as above; a job that is cancelling is not accepted. */
bool queue_requeue(queue *q, const queue_fence *fence, bool counts, int64_t not_before_ms,
                   const queue_ending *ending, bool *accepted, error *e);

/* The job whose result was stored last under this key, and what was stored with it, to be freed. */
bool queue_recall(queue *q, const char *key, char id[ULID_SIZE], char **inputs, bool *found, error *e);

/* ---- temporary files of copies of results, in directories of others */

typedef struct queue_copy {
    char *directory, *name;
} queue_copy;

void queue_copies_free(queue_copy *copies, size_t count);

/* Writes down that a file of this name, used once, may be made in the directory. */
bool queue_note_copy(queue *q, const char *directory, const char *name, error *e);
bool queue_forget_copy(queue *q, const char *name, error *e);
bool queue_list_copies(queue *q, queue_copy **copies, size_t *count, error *e);

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
    int64_t seq; /* rises over all jobs, never used twice */
    int64_t at_ms;
    char id[ULID_SIZE];           /* of the job */
    char owner[QUEUE_OWNER_SIZE]; /* of the job */
    queue_event_type type;
    queue_state state;     /* of the job, or of the task */
    queue_outcome outcome; /* with a final state */
    int frame;             /* QUEUE_NO_FRAME: none */
    int attempt;           /* 0: none */
} queue_event;

/* As `after_seq`: only what comes from now on. */
#define QUEUE_EVENTS_FROM_NOW (-1)

typedef struct queue_event_filter {
    const char *id, *owner, *label; /* NULL: any; the labels are those that the job has now */
    int64_t after_seq;
    int limit;
} queue_event_filter;

typedef struct queue_event_page {
    queue_event *events; /* oldest first, to be freed */
    size_t count;
    int64_t position; /* every event up to this number was looked at; where the next page begins */
    bool more;      /* there may be more behind it now: the page is full, or a bounded number was looked at */
    int64_t newest; /* number of any event so far; a page asked for behind it is empty and stands there */
    /* Events up to this number were removed with their jobs, not necessarily all; 0: none, or the page is of one job,
     * whose events go together. */
    int64_t removed_up_to;
} queue_event_page;

/* Looks at a bounded number of events, in the order of their numbers; of one job only at its own. So a filter may
 * leave a page empty although there is more. The events of a job go with it. */
bool queue_list_events(queue *q, const queue_event_filter *filter, queue_event_page *page, error *e);

/* ---- directories of tasks: what is to be removed, and what was found */

/* A task that was forgotten, whose result and attempts 1 .. `attempts` are to be removed. It is noted by the
 * transaction that forgets the job, and nothing else gives the right to remove a result. */
typedef struct queue_removal {
    int64_t number; /* rises */
    char id[ULID_SIZE];
    int frame, attempts;
} queue_removal;

/* Those with numbers above `after`, of one job or (id NULL) of all; to be freed. */
bool queue_list_removals(queue *q, const char *id, int64_t after, int limit, queue_removal **removals,
                         size_t *count, error *e);
/* They have been removed. */
bool queue_end_removals(queue *q, const queue_removal *removals, size_t count, error *e);

/* A directory whose name says that it belongs to a task, and what the queue says to that. */
typedef struct queue_directory {
    char id[ULID_SIZE];
    int frame;
    int attempt;        /* 0: a result */
    bool to_be_removed; /* see queue_removal */
    bool known;         /* the task is there: */
    queue_state state;  /* queued, running or final */
    int last_attempt;
} queue_directory;

/* Fills in what the queue says. Costs a look into an index for each. */
bool queue_find_directories(queue *q, queue_directory *directories, size_t count, error *e);

/* Ends a task that waits since its result is there: the database is older than the result. *accepted false: the
 * task does not wait. */
bool queue_end_found(queue *q, const char *id, int frame, queue_outcome outcome, bool *accepted, error *e);

/* A job that has succeeded and is not in the queue, as far as its results tell. */
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

/* Puts them into the queue, all or none, owned by "" and kept until they are deleted. */
bool queue_adopt(queue *q, const queue_adoption *jobs, size_t count, error *e);

/* ---- webhooks */

/* That a job with a webhook has ended; put into the outbox with the end itself, once for each end. */
typedef struct queue_delivery {
    int64_t number;
    char id[ULID_SIZE]; /* of the job */
    char *url;
    queue_state state;
    queue_outcome outcome;
    int tries;      /* that failed */
    int64_t due_ms; /* wall clock: not to be tried before */
} queue_delivery;

void queue_delivery_clear(queue_delivery *delivery);

/* The one that is due first, which may lie ahead; it stays until it is ended. Passes by those whose address begins
 * with an item of `but`, a JSON array of texts: to mean a host and no other, these end with the slash behind it. */
bool queue_next_delivery(queue *q, const char *but, queue_delivery *delivery, bool *found, error *e);

/* It is delivered or given up; with again_ms > 0 it is to be tried again then. */
bool queue_end_delivery(queue *q, int64_t number, int64_t again_ms, error *e);

/* ---- news */

/* Waits until something happened since *seen (0 at the beginning): changes were stored, or somebody
 * called queue_signal; or until the deadline (monotonic). True, and *seen brought up to date, when
 * something did. No event is missed by who waits first and lists then. */
bool queue_wait(queue *q, uint64_t *seen, int64_t until_ms);
void queue_signal(queue *q);

#endif
