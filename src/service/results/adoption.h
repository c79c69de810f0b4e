// SPDX-License-Identifier: Apache-2.0
/* adoption: adds jobs to the queue from their results, after the database was lost.
 *
 * Members that a report does not contain stay unknown: the owner, the attempts, and all times except the time
 * in the id and the modification time of the report. Jobs that share files of a result by hard links are
 * added without name, labels, output.directory and webhook, because their reports may describe another job.
 */
#ifndef HEXAD_SERVICE_RESULTS_ADOPTION_H
#define HEXAD_SERVICE_RESULTS_ADOPTION_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"
#include "service/queue/queue.h"

/* Adds the jobs of `count` results to the queue. The list must be sorted by id, then by frame, and filled by
 * queue_find_directories. Skips results of jobs that are in the queue, results that are noted for removal,
 * and, with a warning, results that cannot be read. *adopted is the number of added jobs, also on failure.
 * Errors: those of queue_adopt. */
bool adoption_run(queue *q, const char *work_dir, const queue_directory *results, size_t count,
                  size_t *adopted, error *e);

#endif
