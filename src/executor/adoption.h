/* adoption: jobs that are read back from their results, whose database was lost.
 *
 * What a report does not tell is not known: the owner, attempts, the times but those of the id and of the report.
 */
#ifndef HEXAD_EXECUTOR_ADOPTION_H
#define HEXAD_EXECUTOR_ADOPTION_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"
#include "queue/queue.h"

/* Puts the jobs of these results into the queue. The list is sorted by id, and within one by frame; those that are
 * known or to be removed are passed by, as are those that cannot be read. *adopted: how many jobs. */
bool adoption_run(queue *q, const char *state_dir, const queue_directory *results, size_t count,
                  size_t *adopted, error *e);

#endif
