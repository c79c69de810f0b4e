// SPDX-License-Identifier: Apache-2.0
/* output_cleanup: removes temporary files that an interrupted copy of a result left in an output directory.
 *
 * The queue stores their names: a copy is noted there (queue_note_copy) before its temporary file is created.
 * Only these files are removed. A task of the runner removes them, because an output directory may be slow.
 * If a directory cannot be reached, the task tries again every minute.
 */
#ifndef HEXAD_SERVICE_RESULTS_OUTPUT_CLEANUP_H
#define HEXAD_SERVICE_RESULTS_OUTPUT_CLEANUP_H

#include "base/core/runner.h"
#include "service/queue/queue.h"
#include "files/output.h"

typedef struct output_cleanup output_cleanup;

/* Adds the task to the runner, if a copy is noted. Call it before the first copy begins: every copy that is
 * noted at this time counts as interrupted. *made is set, also on failure. The queue and the outputs must
 * outlive *made. Errors: those of queue_list_copies. */
bool output_cleanup_add(runner *to, queue *q, const store_outputs *outputs, output_cleanup **made, error *e);
/* After runner_stop, which waits for the removal in progress. Accepts NULL. */
void output_cleanup_free(output_cleanup *c);

#endif
