/* executor: takes tasks from the queue, runs each as an attempt of an engine, and settles it.
 *
 * One supervisor thread claims tasks while there is room and waits for all attempts at once; it never
 * sleeps for a fixed time. Room is threads and memory of this host: attempts take from it what their jobs
 * ask for, and as many run at once as fit; none is started while the disk is full. Time limits come from the job's spec (/limits), else from the
 * settings. A job that asks for what another one was given is given the same (executor/cache). A worker
 * that crashes is tried again, after a while, until max_attempts; one that fails since a disk is full or fails does not
 * count. Any thread may call these functions.
 */
#ifndef HEXAD_EXECUTOR_EXECUTOR_H
#define HEXAD_EXECUTOR_EXECUTOR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/sandbox.h"
#include "executor/progress_ring.h"
#include "queue/queue.h"
#include "store/inputs.h"
#include "store/output.h"

typedef struct executor executor;

typedef struct executor_settings {
    const char *state_dir; /* absolute; attempts/ and results/ are made in it */
    const char *worker;    /* path of hexad-worker */
    const char *const *input_roots;
    size_t input_root_count;
    store_inputs *inputs;         /* files that clients sent; outlives the executor; NULL: none */
    double inputs_keep_s;         /* after their last use; 0: for ever */
    int workers;                  /* attempts at once; 0: one per thread */
    int threads;                  /* of all attempts; 0: the processors there are */
    int64_t host_memory_mb;       /* of all attempts; 0: nine tenths of what there is */
    int64_t memory_mb;            /* of a job that names no limit, > 0 */
    bool cache;                   /* results are given to jobs that ask for the same */
    int64_t file_mb;              /* the longest file that a worker may write; 0: no limit */
    sandbox_mode sandbox;         /* that workers enter */
    int most_of_owner;            /* attempts of one owner at once; 0: any number */
    double timeout_s, stall_s;    /* of a job that names no limit; 0: none */
    store_outputs outputs;        /* where copies of results may go; copied, but for the roots' texts */
    double grace_s;               /* between SIGTERM and SIGKILL */
    double retry_s, retry_most_s; /* how long a crashed task waits the first time, and at most */
    int64_t free_space_mb; /* of the state directory's disks: with less no attempt is started; 0: any */
    int storage_retries;   /* how often a task is tried again because a disk was full or failed */
    int max_interruptions; /* of a task by the end of the daemon or the host; 0: any number */
    bool adopt;            /* results that the queue does not know are read back into it */
} executor_settings;

/* Settles what a crash left, holds results/ and attempts/ against the queue (executor/inventory), gives both the same
 * instance (executor/instance) and starts the supervisor. Copies the settings; the queue must outlive
 * the executor. */
executor *executor_start(const executor_settings *settings, queue *q, error *e);

/* Ends the supervisor. Attempts that still run are stopped at once and put back in the queue.
 * Accepts NULL. */
void executor_stop(executor *x);

/* As queue_delete, with the job's directories. */
bool executor_delete(executor *x, const char *id, bool *found, bool *deleted, error *e);

/* A job was put in the queue, or edited. */
void executor_wake(executor *x);

/* What an attempt takes of the host, `width` being its threads: where a job asks for nothing (0) its
 * share, of threads those of the host divided by the workers. More threads than there are become those; an
 * error (limit_memory) when the memory can never be had. */
bool executor_size(const executor *x, int *width, int64_t *memory_mb, error *e);

/* As queue_tell; what follows for the attempts follows at once. */
bool executor_tell(executor *x, const char *id, queue_command command, bool *found, bool *changed,
                   queue_state *now, error *e);

/* The newest progress of a running job (of an array: of one of its tasks), one JSON object as text to be
 * freed; NULL when there is none. */
char *executor_progress(executor *x, const char *id);

/* All the newest progress lines. queue_wait returns when there is another. */
progress_ring *executor_progress_ring(executor *x);

typedef struct executor_load {
    int attempts, workers;
    int threads, all_threads;
    int64_t memory_mb, all_memory_mb;
} executor_load;

/* What runs at the moment, and what may. */
executor_load executor_get_load(executor *x);

typedef struct executor_space {
    int64_t free_bytes, floor_bytes;
} executor_space;

/* What is free on the disks of the state directory, and what there has to be before an attempt is started. */
executor_space executor_get_space(const executor *x);

/* While it is held no attempt is started and what runs goes on; not kept over a restart. */
void executor_hold(executor *x, bool on);
/* Neither held nor draining. */
bool executor_takes_jobs(const executor *x);

/* Stops claiming and lets what runs end; what still runs after `seconds` is stopped and put back in
 * the queue without counting the attempt. Returns at once; may be called again to shorten the time.
 */
void executor_drain(executor *x, double seconds);

/* A drain without patience: what runs is killed, asked to end or not, and put back. */
void executor_force(executor *x);
bool executor_is_draining(const executor *x);

/* Takes over the times and the length of files from these settings, for attempts that start from
 * now on; the grace time holds at once. */
void executor_change(executor *x, const executor_settings *settings);

/* How often the supervisor has looked at its slots: a number that grows after each executor_wake, unless the
 * supervisor is stuck. */
uint64_t executor_turns(const executor *x);

/* A descriptor that becomes readable when a drain has ended. */
int executor_drained_fd(const executor *x);

#endif
