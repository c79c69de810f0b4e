/* leftovers: temporary files that copies of results left in directories of others when the daemon was killed.
 *
 * They were written down before they were made (queue_note_copy), so a start knows their names, and removes these and
 * nothing else. A thread of its own does it, since a directory may be slow; one that cannot be reached, whose disk may
 * be away, is tried again from time to time.
 */
#ifndef HEXAD_EXECUTOR_LEFTOVERS_H
#define HEXAD_EXECUTOR_LEFTOVERS_H

#include "queue/queue.h"
#include "store/output.h"

typedef struct leftovers leftovers;

/* Before any copy begins, as all that are written down are taken for cut off. *made is NULL when there are none. Queue
 * and outputs outlive it. */
bool leftovers_start(queue *q, const store_outputs *outputs, leftovers **made, error *e);
void leftovers_stop(leftovers *l); /* accepts NULL */

#endif
