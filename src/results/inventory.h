/* inventory: compares results/ and attempts/ with the queue, at a start.
 *
 * A complete result of a waiting task ends that task: the database is an older backup that was restored. An entry
 * that belongs to no job, or that is in the way of one, moves to lost+found (results/lost_found). Entries that the
 * queue has noted for removal are left to results/retention. Nothing is deleted. Called by one thread, after
 * settlement_recover.
 */
#ifndef HEXAD_RESULTS_INVENTORY_H
#define HEXAD_RESULTS_INVENTORY_H

#include <stdbool.h>

#include "base/error.h"
#include "queue/queue.h"

/* With `adopt`, results of jobs that are not in the queue are added to it, from their reports, as succeeded jobs. A
 * warning tells how many entries were moved or could not be moved. When an entry that is in the way of a job cannot be
 * moved, that is an error. */
bool inventory_take(queue *q, const char *work_dir, bool adopt, error *e);

/* Parses the name of a result's directory. False when it is not such a name. */
bool inventory_read_name(const char *name, queue_directory *directory);

#endif
