// SPDX-License-Identifier: Apache-2.0
/* inventory: compares results/ and attempts/ with the queue, and uploads with their hashes.
 *
 * One walk finds the differences, and reads as much of the results as the caller needs. The start repairs: if a
 * waiting task has a complete result, the database is a restored older backup, and the task ends with this
 * result. An entry without a job, and an entry whose name a task will need, move to lost+found/results/ or
 * lost+found/attempts/, where they stay until an administrator removes them or moves them back. A symbolic link is moved,
 * not followed. Entries that are noted for removal stay; service/results/retention removes them. Nothing is deleted. `--adopt` adds jobs for results without a job (service/results/adoption), and `--check`
 * prints the differences. Called by one thread.
 */
#ifndef HEXAD_SERVICE_RESULTS_INVENTORY_H
#define HEXAD_SERVICE_RESULTS_INVENTORY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include "base/core/error.h"
#include "service/queue/queue.h"

/* The file by which the executor checks whether a directory can be written. A disk that fails may keep one. */
#define INVENTORY_PROBE_NAME ".probe"
#define INVENTORY_LOST_FOUND "lost+found"

/* For the start, after settlement_recover: compares all entries but INVENTORY_PROBE_NAME. With `adopt`, jobs that are not
 * in the queue are first added from the reports of their results, as succeeded jobs. Logs warnings with the number of
 * adopted jobs, of tasks that ended, of moved entries and of entries that could not be moved. Errors: internal, if a
 * directory cannot be listed, a result of a waiting task cannot be read, or an entry whose name a task
 * needs cannot be moved; those of the queue. */
bool inventory_take(queue *q, const char *work_dir, bool adopt, error *e);

typedef struct inventory_tally {
    size_t results, uploads; /* that were looked at */
    size_t findings;
} inventory_tally;

/* In a state directory that no daemon uses: finds succeeded tasks whose result is missing or incomplete, and results of
 * jobs that are not in the queue. With `contents` reads all files of results and uploads, too, finds those whose bytes
 * differ from their hashes, and prints progress to standard error, at most once in a second. Prints a line for each
 * finding, and adds all numbers to *tally. Errors: internal, when the queue or a result cannot be read; the check stops
 * there. */
bool inventory_check(queue *q, const char *work_dir, bool contents, FILE *out, inventory_tally *tally,
                     error *e);

#endif
