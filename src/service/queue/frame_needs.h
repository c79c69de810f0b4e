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

/* Counts the tasks that each queued task waits for, and fails tasks that cannot start. Call it when the tasks
 * of a job become queued: at its submission and at a retry. */
bool frame_needs_begin(database *d, job_state *j, int64_t now, error *e);

/* As frame_needs_begin for held tasks, after the task of `frame` (JOB_STATE_ALL_ENDED: any number of tasks)
 * in another job has ended. */
bool frame_needs_update(database *d, job_state *j, int frame, int64_t now, error *e);

/* *hopeless: the job waits for frames, and no task that a retry would run could start. */
bool frame_needs_are_hopeless(database *d, const job_state *j, bool *hopeless, error *e);

/* Whether the first queued task is held. */
bool frame_needs_hold_first(database *d, const job_state *j, bool *held, error *e);

#endif
