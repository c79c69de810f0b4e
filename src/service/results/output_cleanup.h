/* output_cleanup: removes temporary files that an interrupted copy of a result left in an output directory.
 *
 * The queue stores their names: a copy is noted there (queue_note_copy) before its temporary file is created. Only
 * these files are removed. A thread removes them, because an output directory may be slow. If a directory cannot be
 * reached, the thread tries again every minute until it is stopped.
 */
#ifndef HEXAD_SERVICE_RESULTS_OUTPUT_CLEANUP_H
#define HEXAD_SERVICE_RESULTS_OUTPUT_CLEANUP_H

#include "service/queue/queue.h"
#include "files/output.h"

typedef struct output_cleanup output_cleanup;

/* Starts the thread. Call it before the first copy begins: every copy that is noted at this time counts as interrupted.
 * *made is NULL on failure, and if no copy is noted. The queue and the outputs must outlive *made. Errors: those of
 * queue_list_copies and background_start. */
bool output_cleanup_start(queue *q, const store_outputs *outputs, output_cleanup **made, error *e);
/* Waits for the removal in progress and frees. Accepts NULL. */
void output_cleanup_stop(output_cleanup *c);

#endif
