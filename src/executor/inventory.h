/* inventory: what stands in results/ and attempts/ at a start, held against the queue.
 *
 * A result of a job that waits ends it: the database is older than the result, a backup that was put back. What
 * belongs to no job, or is in the way of one, is put into lost+found (executor/lost_found). What the queue has noted to
 * be removed is left to executor/retention. Nothing is deleted. Called by one thread, at a start, after
 * settlement_recover.
 */
#ifndef HEXAD_EXECUTOR_INVENTORY_H
#define HEXAD_EXECUTOR_INVENTORY_H

#include <stdbool.h>

#include "base/error.h"
#include "queue/queue.h"

/* With `adopt` results of jobs that are not in the queue are read back into it, from their reports, as jobs that
 * have succeeded. A warning says how many things were put away, or could not be; what stays although it is in the
 * way of a job is an error. */
bool inventory_take(queue *q, const char *state_dir, bool adopt, error *e);

/* Whether a name is that of a result's directory: whose. */
bool inventory_read_name(const char *name, queue_directory *directory);

#endif
