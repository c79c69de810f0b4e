/* publication: the copy of a result into the directory that its job names, on a thread of its own, since
 * that directory may be slow.
 *
 * It comes before the result moves into place: a job whose copy cannot be made fails and says why, and a
 * crash at any point leads to another attempt or finds a result that was copied.
 */
#ifndef HEXAD_EXECUTOR_PUBLICATION_H
#define HEXAD_EXECUTOR_PUBLICATION_H

#include "store/output.h"

typedef struct publication publication;

/* Where the spec wants a copy, with the number of the frame in place, to be freed; NULL: nowhere. */
char *publication_path(const char *spec, int frame);

/* Begins to copy the result in `directory`. The descriptor is written to (eventfd) at the end. What `outputs`
 * points to outlives the publication; texts are copied. */
publication *publication_start(const store_outputs *outputs, const char *directory, const char *path,
                               int end_fd);

bool publication_has_ended(publication *p);

/* Waits for the end, gives the outcome, and frees. */
bool publication_end(publication *p, error *e);

#endif
