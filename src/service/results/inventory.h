// SPDX-License-Identifier: Apache-2.0
/* inventory: compares results/ and attempts/ with the queue, at a start.
 *
 * If a waiting task has a complete result, the database is a restored older backup, and the task ends with
 * this result. An entry without a job, and an entry whose name a task will need, move to lost+found
 * (service/results/lost_found). Entries that are noted for removal stay; service/results/retention removes
 * them. Nothing is deleted. Called by one thread, after settlement_recover.
 */
#ifndef HEXAD_SERVICE_RESULTS_INVENTORY_H
#define HEXAD_SERVICE_RESULTS_INVENTORY_H

#include <stdbool.h>

#include "base/core/error.h"
#include "service/queue/queue.h"

/* The file by which the executor checks whether a directory can be written. A disk that fails may keep one. */
#define INVENTORY_PROBE_NAME ".probe"

/* Compares all entries but INVENTORY_PROBE_NAME. With `adopt`, jobs that are not in the queue are
 * first added from the reports of their results, as succeeded jobs. Logs warnings with the number of adopted
 * jobs, of tasks that ended, of moved entries and of entries that could not be moved. Errors: internal, if a
 * directory cannot be listed, a result of a waiting task cannot be read, or an entry whose name a task
 * needs cannot be moved; those of the queue. */
bool inventory_take(queue *q, const char *work_dir, bool adopt, error *e);

/* Parses the name of a result's directory, "ID" or "ID.FRAME". False if the name has another form. */
bool inventory_read_name(const char *name, queue_directory *directory);

#endif
