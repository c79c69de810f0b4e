/* publication: copies a result to output.directory of its job. A thread does it, because that directory may be slow.
 *
 * The copy is made before the result moves to results/. When it fails, the job fails and tells why. After a crash at
 * any point there is another attempt, or a result that was copied. The temporary file of a copy is noted in the queue
 * before it is made (queue_note_copy) and forgotten with the end of the attempt. The next start removes those that a
 * crash left (results/output_cleanup).
 */
#ifndef HEXAD_RESULTS_PUBLICATION_H
#define HEXAD_RESULTS_PUBLICATION_H

#include "results/output_place.h"

typedef struct publication publication;

/* The name of the temporary file for the copy of the result in this attempt's directory, to be freed. */
char *publication_temporary(const char *directory);

/* Begins to copy the result in `directory` to `path`, for this user. The eventfd `end_fd` is written to at the end. The
 * place must outlive the publication; texts are copied. */
publication *publication_start(output_place *outputs, const char *user, const char *directory,
                               const char *path, int end_fd);

bool publication_has_ended(publication *p);

/* Waits for the end, returns whether the copy succeeded, and frees. */
bool publication_end(publication *p, error *e);

#endif
