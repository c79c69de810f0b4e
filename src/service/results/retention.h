// SPDX-License-Identifier: Apache-2.0
/* retention: deletes jobs with their results and logs, and uploaded files that have not been used for some
 * time.
 *
 * A job is deleted when a client requests it, when its retention has expired by the running time of the
 * daemon (base/core/running_time, which the task of this module stores), or when results have reached a bound
 * (queue_bounds).
 *
 * One transaction deletes the job and notes its directories (queue_removal). Then the directories are
 * removed, and last the note. After a crash or a failure, the task removes the directories that are still
 * noted: at the start, and then every 10 s. Only noted directories are removed. The task also deletes the
 * jobs whose retention has expired, so that no client waits for the removal of large results. Any thread may
 * call these functions.
 */
#ifndef HEXAD_SERVICE_RESULTS_RETENTION_H
#define HEXAD_SERVICE_RESULTS_RETENTION_H

#include <stdbool.h>

#include "base/core/error.h"
#include "base/core/runner.h"
#include "service/queue/queue.h"
#include "service/results/fetches.h"
#include "service/uploads/upload_store.h"

typedef struct retention retention;

/* Adds the task to the runner. results/ and attempts/ must exist. The queue and the inputs must outlive it;
 * the path is copied. After the deletion of a job, 1 is written to the eventfd `space_fd`: disk space may be
 * free for other jobs. Uploaded files that no unfinished job reads are removed `keep_s` seconds after their last
 * use; at the next collection, within an hour, if no user holds them. If keep_s is 0, those that users hold are
 * kept for ever; if inputs is NULL, all are. */
retention *retention_add(runner *to, queue *q, const char *work_dir, store_inputs *inputs, double keep_s,
                         int space_fd);
/* After runner_stop. Stores the running time of the daemon. Accepts NULL. */
void retention_free(retention *r);

/* Call it after a job has ended or its retention has changed. */
void retention_wake(retention *r);

/* Deletes a job like queue_delete, and removes its directories. The task removes later those that cannot be
 * removed now. Errors: those of queue_delete. */
bool retention_delete(retention *r, const char *id, bool *found, bool *deleted, error *e);

/* Records that file `index` < `count` of a result with `count` files was sent to its owner. When all have
 * been sent, the result counts as delivered. */
void retention_note_sent(retention *r, const fetches_result *of, size_t index, size_t count);

/* The number of jobs that were deleted because of a bound, since the start. */
uint64_t retention_count_evicted(const retention *r);

#endif
