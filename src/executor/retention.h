/* retention: forgets jobs, with their results and logs: those whose time is over, and those that are
 * deleted; and files that clients sent and that have not been used for a time.
 *
 * The queue forgets a job and notes in the same transaction what is to be removed (queue_removal); then the
 * directories go, and last the note. What a crash or trouble leaves noted is removed by a thread of its own, at the
 * start and again and again. Nothing else is ever removed. That thread also waits for the next job whose time is
 * over, so that nobody waits for the removal of large results. Any thread may call these.
 */
#ifndef HEXAD_EXECUTOR_RETENTION_H
#define HEXAD_EXECUTOR_RETENTION_H

#include <stdbool.h>

#include "base/error.h"
#include "queue/queue.h"
#include "store/inputs.h"

typedef struct retention retention;

/* Begins. results/ and attempts/ are there. Queue and inputs must outlive it; the path is copied. Files that were
 * sent go when no job that has not ended reads them, keep_s after their last use; 0, or no inputs: never. */
retention *retention_start(queue *q, const char *state_dir, store_inputs *inputs, double keep_s, error *e);
void retention_stop(retention *r); /* accepts NULL */

/* A job has ended, or is to be kept for another time than before. */
void retention_wake(retention *r);

/* As queue_delete, with the job's directories; those that cannot be removed now are later. */
bool retention_delete(retention *r, const char *id, bool *found, bool *deleted, error *e);

#endif
