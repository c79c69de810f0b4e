// SPDX-License-Identifier: Apache-2.0
/* audit: compares the results with the queue, and if requested the bytes of results and uploads with their
 * hashes, in a state directory that no daemon uses. */
#ifndef HEXAD_SERVICE_RESULTS_AUDIT_H
#define HEXAD_SERVICE_RESULTS_AUDIT_H

#include <stddef.h>
#include <stdio.h>

#include "base/core/error.h"
#include "service/queue/queue.h"

typedef struct audit_tally {
    size_t results, uploads; /* that were looked at */
    size_t findings;
} audit_tally;

/* Finds succeeded tasks whose result is missing or incomplete, and results of jobs that are not in the queue.
 * With `contents` reads all files of results and uploads, too, finds those whose bytes differ from their
 * hashes, and prints progress to standard error, at most once in a second. Prints a line for each finding, and
 * adds all numbers to *tally. Errors: internal, when the queue or a result cannot be read; the check stops there. */
bool audit_results(queue *q, const char *work_dir, bool contents, FILE *out, audit_tally *tally, error *e);

#endif
