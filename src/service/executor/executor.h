// SPDX-License-Identifier: Apache-2.0
/* executor: claims tasks from the queue, runs each as an attempt of an engine, and settles it.
 *
 * One supervisor thread claims tasks while resources are free, and waits for all attempts at once. It never
 * sleeps for a fixed time. Each task is processed by a slot (service/executor/slot). Resources are the
 * threads and the memory of this host: an attempt takes the amount that its job requests, and as many
 * attempts run at once as fit. None is started while the disk is full. Time limits come from the job's spec
 * (/limits), else from the settings. A job that equals an earlier one gets its result
 * (service/executor/cache). After a crash of its worker a task is tried again, after a delay, up to
 * max_attempts times. An attempt that fails because a disk is full or failed does not count. Any thread.
 */
#ifndef HEXAD_SERVICE_EXECUTOR_EXECUTOR_H
#define HEXAD_SERVICE_EXECUTOR_EXECUTOR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/runner.h"
#include "base/core/sandbox.h"
#include "service/executor/engine.h"
#include "service/executor/meter.h"
#include "service/executor/progress_ring.h"
#include "service/ledger/ledger.h"
#include "service/queue/queue.h"
#include "service/results/fetches.h"
#include "service/results/output_place.h"
#include "service/uploads/upload_store.h"

typedef struct executor executor;

typedef struct executor_settings {
    const char *state_dir; /* absolute; of the queue and of estimates */
    const char *work_dir;  /* absolute; attempts/ and results/ are created in it */
    const engine *engine;  /* runs attempts */
    void *engine_place;    /* data of the engine; NULL for local; must outlive the executor */
    const char *worker;    /* path of hexad-worker */
    const char *const *input_roots;
    size_t input_root_count;
    store_inputs *inputs;        /* uploaded files; must outlive the executor; NULL: none */
    double inputs_keep_s;        /* seconds for which files are kept after their last use; 0: for ever */
    int workers;                 /* maximum number of simultaneous attempts; 0: one per thread */
    int threads;                 /* of all attempts; 0: the number of processors */
    int64_t host_memory_mb;      /* of all attempts; 0: nine tenths of the host's memory */
    int64_t memory_mb;           /* limit of a job that states none, > 0 */
    bool cache;                  /* equal jobs get the same result */
    int64_t file_mb;             /* maximum size of a file that a worker writes; 0: no limit */
    sandbox_mode sandbox;        /* sandbox that workers enter */
    control_groups *groups;      /* of attempts; must outlive the executor; NULL: none */
    ledger *counts;              /* limits of users; must outlive the executor */
    const user_numbers *weights; /* see queue_resources; must outlive the executor */
    double timeout_s, stall_s;   /* limits, in s, of a job that states none; 0: none */
    /* permitted destinations of result copies; must outlive the executor; NULL: none */
    output_place *outputs;
    double grace_s;               /* between SIGTERM and SIGKILL */
    double retry_s, retry_most_s; /* first and longest delay after a crash */
    /* minimum free space on the state directory's disks to start an attempt; 0: none */
    int64_t free_space_mb;
    int storage_retries; /* maximum number of retries of a task because a disk was full or failed */
    /* maximum number of interruptions of a task by the end of the daemon or the host; 0: no limit */
    int max_interruptions;
    bool adopt; /* add results that are missing in the queue to it */
} executor_settings;

/* Settles tasks that a crash left, compares results/ and attempts/ with the queue
 * (service/results/inventory), gives both the same instance id (service/results/instance_check), and adds the
 * tasks that look after results to the runner. Copies the settings. The queue must outlive the executor. */
executor *executor_open(const executor_settings *settings, queue *q, runner *to, error *e);
/* After executor_stop, if the supervisor was started, and runner_stop. Accepts NULL. */
void executor_free(executor *x);

/* Starts the supervisor: jobs run from now on. */
bool executor_start(executor *x, error *e);
/* Ends the supervisor. Running attempts are stopped at once and queued again, or left to the next daemon
 * (service/executor/engine). */
void executor_stop(executor *x);

/* Like queue_delete, and removes the job's directories. */
bool executor_delete(executor *x, const char *id, bool *found, bool *deleted, error *e);

/* See retention_note_sent and retention_count_evicted. */
void executor_note_sent(executor *x, const fetches_result *of, size_t index, size_t count);
uint64_t executor_count_evicted(const executor *x);

/* Wakes the supervisor. Call it after a job was put into the queue or edited. */
void executor_wake(executor *x);

/* Records a new priority of the job. Attempts that wait in an engine's own queue are queued again. */
void executor_move(executor *x, const char *id, int priority);

/* The largest memory limit that a job may have with these settings, MiB. */
int64_t executor_most_memory_mb(const executor_settings *settings);

/* Replaces the threads (*width) and memory requested by a job by the amounts that its attempt takes of the
 * host. 0 becomes the default: the threads of the host divided by the workers, the default memory. More
 * threads than the host has become all of them. Error: limit_memory (the host has less memory). */
bool executor_size(const executor *x, int *width, int64_t *memory_mb, error *e);

/* Like queue_apply_command, and stops the running attempts of a cancelled job at once. */
bool executor_apply_command(executor *x, const char *id, queue_command command, bool *found, bool *changed,
                            queue_state *now, error *e);

/* Call it if an equal job has succeeded with unchanged inputs: this job gets the same result, even if no
 * worker can be started. */
void executor_offer(executor *x, const char *id);

/* The newest progress line of a running job (of an array: of one of its tasks): the text of one JSON object,
 * to be freed. NULL when there is none. */
char *executor_progress(executor *x, const char *id);

/* Writes the host on which a worker runs this task. False: none does, or the host is not known yet. */
bool executor_find_host(executor *x, const char *id, int task, char host[ENGINE_HOST_SIZE]);

/* The newest progress lines of all jobs. A new one wakes the tasks of queue_wake_on_change. */
progress_ring *executor_progress_ring(executor *x);

typedef struct executor_load {
    int attempts, workers;
    int threads, all_threads;
    int64_t memory_mb, all_memory_mb;
    int most_of_owner; /* maximum number of attempts of one owner; 0: no limit */
} executor_load;

/* Resources used by the attempts, and total resources. */
executor_load executor_get_load(executor *x);

const meter *executor_get_meter(const executor *x);

typedef struct executor_space {
    int64_t size_bytes, free_bytes; /* of the fullest disk of the state directory */
    const char *directory;          /* state_dir or work_dir, whichever is on this disk; the executor's */
    int64_t floor_bytes;            /* the minimum that an attempt needs to start */
} executor_space;

executor_space executor_get_space(const executor *x);

/* Whether the last write to each directory of the state directory succeeded: that of an attempt, a result or
 * an upload, or that of a check, which writes at least every ten seconds. Otherwise the error names the
 * directory. */
bool executor_can_write(const executor *x, error *e);
/* Call it after a write to the state directory failed: the directories are checked at once. */
void executor_note_failed_write(executor *x);

/* While closed, the executor starts no attempt; running ones continue. A restart of the daemon opens it. */
void executor_close(executor *x, bool on);
/* Whether it is neither closed nor draining. */
bool executor_takes_jobs(const executor *x);

/* Stops claiming; running attempts continue. Attempts that still run after `seconds` are stopped and queued
 * again without being counted. Returns at once. May be called again to shorten the time. */
void executor_drain(executor *x, double seconds);

/* A drain without delay: running attempts are killed and queued again. */
void executor_force(executor *x);
bool executor_is_draining(const executor *x);

/* Applies timeout_s, stall_s and file_mb to attempts that start from now on, and grace_s at once. */
void executor_change(executor *x, const executor_settings *settings);

/* The number of iterations of the supervisor's loop. It grows after each executor_wake, unless the
 * supervisor hangs. */
uint64_t executor_turns(const executor *x);

/* A descriptor that becomes readable at the end of a drain. */
int executor_drained_fd(const executor *x);

#endif
