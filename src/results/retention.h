/* retention: removes deleted jobs, jobs whose retention is over, and jobs that have to go because results have met a
 * bound (queue_bounds), with their results and logs; and uploaded files that have not been used for a time.
 *
 * A retention is over when base/running_time says so; this thread stores that time.
 *
 * One transaction deletes the job and notes its directories (queue_removal). Then the directories are removed, and
 * last the note. After a crash or a failure, a thread removes what is still noted: at the start, and then again and
 * again. Only noted directories are removed. The same thread deletes the jobs whose retention is over, so that no
 * client waits for the removal of large results. Any thread may call these functions.
 */
#ifndef HEXAD_RESULTS_RETENTION_H
#define HEXAD_RESULTS_RETENTION_H

#include <stdbool.h>

#include "base/error.h"
#include "queue/queue.h"
#include "results/fetches.h"
#include "store/inputs.h"

typedef struct retention retention;

/* Starts the thread. results/ and attempts/ must exist. The queue and the inputs must outlive it; the path is copied.
 * `room_fd`, an eventfd, is written when a job was deleted: there may be room for the results of others.
 * Uploaded files are removed `keep_s` after their last use, unless an unfinished job reads them. They are kept for ever
 * when keep_s is 0 or inputs is NULL. */
retention *retention_start(queue *q, const char *work_dir, store_inputs *inputs, double keep_s, int room_fd,
                           error *e);
void retention_stop(retention *r); /* accepts NULL */

/* Call it when a job has ended or its retention has changed. */
void retention_wake(retention *r);

/* Like queue_delete, and removes the job's directories. Those that cannot be removed now are removed later. */
bool retention_delete(retention *r, const char *id, bool *found, bool *deleted, error *e);

/* File `index` of the `count` files of a result was sent to its owner. When that was the last one, the result counts as
 * delivered. */
void retention_note_sent(retention *r, const fetches_result *of, size_t index, size_t count);

/* How many jobs were deleted because of a bound. */
uint64_t retention_count_evicted(const retention *r);

#endif
