// SPDX-License-Identifier: Apache-2.0
/* frame_needs: tasks of arrays that wait for the tasks of the same frame in other jobs
 * (queue_submission.after_frames).
 *
 * task.waits is the number of these tasks that have not succeeded with an accepted outcome. A queued task
 * with waits > 0 is held: it is not claimed. If one of the tasks it waits for has ended otherwise, it fails.
 *
 * Private to src/service/queue. Call every function inside a change (service/database/database). The
 * functions change tasks and the counts of *j, which the caller saves.
 */
#ifndef HEXAD_SERVICE_QUEUE_FRAME_NEEDS_H
#define HEXAD_SERVICE_QUEUE_FRAME_NEEDS_H

#include "service/queue/job_state.h"

/* The number of jobs for whose frames the tasks of the job wait. A task that becomes queued is held with this
 * number, until it is examined. */
bool frame_needs_count(database *d, const job_state *j, int *count, error *e);

/* Examines the held task of `frame`, whose task in another job has ended: fails it if it cannot start, and counts
 * anew what it waits for. */
bool frame_needs_update(database *d, job_state *j, int frame, int64_t now, error *e);

/* Examines the held tasks with the numbers from `first` to `end` - 1. Does not record that tasks have ended. */
bool frame_needs_examine(database *d, job_state *j, int first, int end, int64_t now, error *e);

/* *hopeless: the job waits for frames, and no task that a retry would run could start. */
bool frame_needs_are_hopeless(database *d, const job_state *j, bool *hopeless, error *e);

/* Whether the first queued task is held. */
bool frame_needs_hold_first(database *d, const job_state *j, bool *held, error *e);

#endif
