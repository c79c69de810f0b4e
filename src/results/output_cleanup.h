/* output_cleanup: removes temporary files that an interrupted copy of a result left in an output directory.
 *
 * The queue knows their names, because a copy is noted there (queue_note_copy) before its temporary file is made. Only
 * these files are removed. A thread does it, because an output directory may be slow. When a directory cannot be
 * reached, the thread tries again every minute.
 */
#ifndef HEXAD_RESULTS_OUTPUT_CLEANUP_H
#define HEXAD_RESULTS_OUTPUT_CLEANUP_H

#include "queue/queue.h"
#include "store/output.h"

typedef struct output_cleanup output_cleanup;

/* Starts the thread. Call it before the first copy begins: every copy that the queue notes now counts as interrupted.
 * *made is NULL when there is none. The queue and the outputs must outlive it. */
bool output_cleanup_start(queue *q, const store_outputs *outputs, output_cleanup **made, error *e);
void output_cleanup_stop(output_cleanup *c); /* accepts NULL */

#endif
