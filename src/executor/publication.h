/* publication: the copy of a result into the directory that its job names, on a thread of its own, since
 * that directory may be slow.
 *
 * It comes before the result moves into place: a job whose copy cannot be made fails and says why, and a
 * crash at any point leads to another attempt or finds a result that was copied. The temporary file of a copy is
 * noted in the queue before it is made (queue_note_copy) and forgotten with the end of the attempt. The next start
 * removes those that a crash left (executor/output_cleanup).
 */
#ifndef HEXAD_EXECUTOR_PUBLICATION_H
#define HEXAD_EXECUTOR_PUBLICATION_H

#include "queue/queue.h"
#include "store/output.h"

typedef struct publication publication;

/* Where the spec wants a copy, with the number of the frame in place, to be freed; NULL: nowhere. */
char *publication_path(const char *spec, int frame);

/* The name of the temporary file of a copy of the result in this directory of an attempt, to be freed. */
char *publication_temporary(const char *directory);

/* Begins to copy the result in `directory`. The descriptor is written to (eventfd) at the end. The queue and what
 * `outputs` points to outlive the publication; texts are copied. */
publication *publication_start(queue *q, const store_outputs *outputs, const char *directory,
                               const char *path, int end_fd);

bool publication_has_ended(publication *p);

/* Waits for the end, gives the outcome, and frees. */
bool publication_end(publication *p, error *e);

#endif
