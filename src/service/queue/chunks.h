// SPDX-License-Identifier: Apache-2.0
/* chunks: blocks of consecutive tasks of an array that run one after another (queue_submission.chunk).
 *
 * The task with the number n is in the chunk n / job_state.chunk. A task is ready if it is queued and waits
 * for no frame of another job (service/queue/frame_needs).
 *
 * Private to src/service/queue. Call every function inside a change (service/database/database).
 */
#ifndef HEXAD_SERVICE_QUEUE_CHUNKS_H
#define HEXAD_SERVICE_QUEUE_CHUNKS_H

#include "service/queue/job_state.h"

/* Finds the first ready task of a chunk without a running task. *number: -1: there is none. The cost grows
 * with the number of chunks that have both a running and a ready task. */
bool chunks_find_task(database *d, const job_state *j, int *number, error *e);

/* Finds the first ready task of the chunk of `task` after it. *number: -1: there is none. */
bool chunks_find_next(database *d, const job_state *j, int task, int *number, error *e);

/* Whether there are ready tasks, each in a chunk with a running task. */
bool chunks_are_busy(database *d, const job_state *j, bool *busy, error *e);

#endif
