// SPDX-License-Identifier: Apache-2.0
/* pieces: changes of many tasks of a job, in transactions with a bounded number of rows.
 *
 * A cancellation, a retry, the failure of dependent jobs and the examination of held tasks may concern 100 000
 * tasks. The first change records in the row of the job what has to be done (job_state.target, examine_from); it
 * does it, too, if the job has few tasks. Otherwise each piece changes a range of tasks and the counts of the job.
 * The thread that began it and a task (queue_do_piece) continue it; after a crash the task does. Until
 * then no task of the job is claimed if it has a target. doc/queue.md lists all changes of many rows.
 *
 * Private to src/service/queue; queue.h has the public functions. Call these inside a change
 * (service/database/database). The functions change *j, which the caller saves.
 */
#ifndef HEXAD_SERVICE_QUEUE_PIECES_H
#define HEXAD_SERVICE_QUEUE_PIECES_H

#include "service/queue/job_state.h"

/* Begins to end all waiting tasks (QUEUE_FAILED, with `message`; QUEUE_CANCELLED), or to queue all tasks without
 * success (QUEUE_QUEUED). */
bool pieces_begin(database *d, job_state *j, queue_state target, const char *message, int64_t now, error *e);

/* Begins to fail all waiting tasks, because this job, which depends on the job with the seq `need`, will not
 * start. */
bool pieces_fail_dependent(database *d, job_state *j, int64_t need, int64_t now, error *e);

/* Begins to examine all held tasks (service/queue/frame_needs). */
bool pieces_examine(database *d, job_state *j, int64_t now, error *e);

/* Does one piece of a job that has a target or held tasks to examine. */
bool pieces_next(database *d, job_state *j, int64_t now, error *e);

#endif
