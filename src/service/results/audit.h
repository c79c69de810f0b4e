// SPDX-License-Identifier: Apache-2.0
/* audit: compares the results with the queue, in a state directory that no daemon uses. */
#ifndef HEXAD_SERVICE_RESULTS_AUDIT_H
#define HEXAD_SERVICE_RESULTS_AUDIT_H

#include <stddef.h>
#include <stdio.h>

#include "base/core/error.h"
#include "service/queue/queue.h"

/* Finds succeeded tasks whose result is missing or incomplete, and results of jobs that are not in the queue.
 * Prints a line for each and adds their number to *findings. Adds the number of checked results to *results.
 * Errors: internal, when the queue or a result cannot be read; the check stops there. */
bool audit_results(queue *q, const char *work_dir, FILE *out, size_t *results, size_t *findings, error *e);

#endif
