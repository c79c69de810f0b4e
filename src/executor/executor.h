/* executor: takes jobs from the queue, runs each as an attempt of an engine, and settles it.
 *
 * One supervisor thread claims jobs while slots are free and waits for all attempts at once; it
 * never sleeps for a fixed time. Limits come from the job's spec (/limits), else from the settings.
 * A worker that crashes is tried again until max_attempts. Any thread may call these functions.
 */
#ifndef HEXAD_EXECUTOR_EXECUTOR_H
#define HEXAD_EXECUTOR_EXECUTOR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/sandbox.h"
#include "queue/queue.h"

typedef struct executor executor;

typedef struct executor_settings {
    const char *state_dir; /* absolute; attempts/ and results/ are made in it */
    const char *worker;    /* path of hexad-worker */
    const char *const *input_roots;
    size_t input_root_count;
    int workers;               /* attempts at once; 0: one per core */
    int64_t memory_mb;         /* of a job that names no limit, > 0 */
    int64_t file_mb;           /* the longest file that a worker may write; 0: no limit */
    sandbox_mode sandbox;      /* that workers enter */
    double timeout_s, stall_s; /* of a job that names no limit; 0: none */
    double grace_s;            /* between SIGTERM and SIGKILL */
} executor_settings;

/* Settles what a crash left and starts the supervisor. Copies the settings; the queue must outlive
 * the executor. */
executor *executor_start(const executor_settings *settings, queue *q, error *e);

/* Ends the supervisor. Attempts that still run are stopped at once and put back in the queue.
 * Accepts NULL. */
void executor_stop(executor *x);

/* A job was put in the queue. */
void executor_wake(executor *x);

/* As queue_cancel; a running attempt is asked to end. */
bool executor_cancel(executor *x, const char *id, bool *found, bool *changed, queue_state *now,
                     error *e);

/* The newest progress of a running job, one JSON object as text to be freed; NULL when there is
 * none. */
char *executor_progress(executor *x, const char *id);

/* Stops claiming and lets what runs end; what still runs after `seconds` is stopped and put back in
 * the queue without counting the attempt. Returns at once; may be called again to shorten the time.
 */
void executor_drain(executor *x, double seconds);

/* A drain without patience: what runs is killed, asked to end or not, and put back. */
void executor_force(executor *x);
bool executor_is_draining(const executor *x);

/* Takes over the memory, the times and the length of files from these settings, for attempts that start from
 * now on; the grace time holds at once. */
void executor_change(executor *x, const executor_settings *settings);

/* How often the supervisor has looked at its slots: a number that grows after each executor_wake, unless the
 * supervisor is stuck. */
uint64_t executor_turns(const executor *x);

/* A descriptor that becomes readable when a drain has ended. */
int executor_drained_fd(const executor *x);

#endif
