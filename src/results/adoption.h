/* adoption: adds jobs to the queue from their results, after the database was lost.
 *
 * Unknown are all members that a report does not contain: the owner, the attempts, and all times but those of the id
 * and of the report. Jobs that share files of a result by hard links are added without name, labels, output.directory
 * and webhook, because their reports may be those of another job.
 */
#ifndef HEXAD_RESULTS_ADOPTION_H
#define HEXAD_RESULTS_ADOPTION_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"
#include "queue/queue.h"

/* Adds the jobs of these results to the queue. The list is sorted by id, then by frame. Results that the queue knows,
 * that are noted for removal, or that cannot be read are skipped. *adopted is the number of added jobs. */
bool adoption_run(queue *q, const char *work_dir, const queue_directory *results, size_t count,
                  size_t *adopted, error *e);

#endif
