// SPDX-License-Identifier: Apache-2.0
/* job_state: the variable part of a job: the numbers of its tasks by state, its commands, and the state that
 * follows from both.
 *
 * Private to src/service/queue. Call every function inside a change (service/database/database). To change
 * tasks: load the job state, adjust its counts, save it (service/queue/job_save).
 */
#ifndef HEXAD_SERVICE_QUEUE_JOB_STATE_H
#define HEXAD_SERVICE_QUEUE_JOB_STATE_H

#include "service/database/database.h"
#include "service/queue/queue.h"

typedef struct job_state {
    int64_t seq, revision;
    queue_state state; /* as stored; job_save updates it */
    bool array, ordered, paused, cancelled;
    int pending; /* number of jobs that this one waits for */
    int tasks, ready, delayed, running, succeeded, failed, cancelled_tasks, timed_out, unresolved,
        not_converged;
    int attempts;
    int64_t started_ms, finished_ms, retention_s;
    int chunk;       /* tasks of a chunk (service/queue/chunks); 1: there are no chunks */
    int held;        /* ready tasks that wait for frames of other jobs (service/queue/frame_needs) */
    bool first_held; /* set by job_save: in an ordered job the first queued task is held */
    int ended;       /* the frame that has ended since the job state was loaded, see job_state_note_ended */
    /* Changes of many tasks (service/queue/pieces): the state that the tasks get, from the number target_from on; the
     * number from which held tasks are examined. */
    int target; /* QUEUE_QUEUED, QUEUE_FAILED, QUEUE_CANCELLED; JOB_STATE_NO_TARGET: none */
    int target_from;
    int examine_from; /* -1: none */
} job_state;

#define JOB_STATE_NO_TARGET (-1)

/* No task of a frame has ended; several have. */
#define JOB_STATE_NONE_ENDED QUEUE_NO_FRAME
#define JOB_STATE_ALL_ENDED (QUEUE_NO_FRAME + 1)

/* *found is false if there is no such job. */
bool job_state_load(database *d, const char *id, job_state *j, bool *found, error *e);
/* The job must exist. */
bool job_state_load_seq(database *d, int64_t seq, job_state *j, error *e);

/* The columns of job that job_state_load_row reads. Loads the row of a statement; *found is false if there
 * is none. */
#define JOB_STATE_COLUMNS                                                                               \
    "seq, revision, state, is_array, is_paused, is_cancelled, pending, tasks, ready, delayed, running," \
    " succeeded, failed, cancelled, timed_out, not_converged, attempts, started_ms, finished_ms, "      \
    "retention_s, is_ordered, unresolved, held, chunk, target, target_from, examine_from"
bool job_state_load_row(database *d, sqlite3_stmt *s, job_state *j, bool *found, error *e);

/* The state that follows from the counts and flags. */
queue_state job_state_derive(const job_state *j);

/* Records that the task of this frame has ended (JOB_STATE_ALL_ENDED: several tasks), for tasks of other jobs
 * that wait for it. */
void job_state_note_ended(job_state *j, int frame);

/* Counts the outcome of a task that succeeded. */
void job_state_count_outcome(job_state *j, queue_outcome outcome);

/* Adds the first event of a job whose row was just inserted, and adds the job to the counts of its owner. */
bool job_state_begin(database *d, const job_state *j, int64_t now, error *e);

/* Counts the jobs for which this one still waits. *lost: the seq of one that had to succeed, and has ended without
 * success or with an outcome that it does not accept; 0: none. */
bool job_state_count_needs(database *d, const job_state *j, int *pending, int64_t *lost, error *e);

/* Adds an event. `frame` may be QUEUE_NO_FRAME; `attempt` is 0 if the event belongs to no attempt. */
bool job_state_add_event(database *d, int64_t seq, queue_event_type type, queue_state state,
                         queue_outcome outcome, int frame, int attempt, int64_t now, error *e);

/* The counter of tasks that ended in the state `final`. */
int *job_state_counter(job_state *j, queue_state final);

#endif
