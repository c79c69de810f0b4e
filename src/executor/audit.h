/* audit: results, held against the queue. For a directory that no daemon uses. */
#ifndef HEXAD_EXECUTOR_AUDIT_H
#define HEXAD_EXECUTOR_AUDIT_H

#include <stddef.h>
#include <stdio.h>

#include "base/error.h"
#include "queue/queue.h"

/* Looks for tasks that succeeded whose result is missing or not whole, and for results of jobs that the queue does not
 * know. Prints a line for each and adds them to *findings; *results are those that were looked at. */
bool audit_results(queue *q, const char *state_dir, FILE *out, size_t *results, size_t *findings, error *e);

#endif
