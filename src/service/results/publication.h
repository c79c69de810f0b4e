// SPDX-License-Identifier: Apache-2.0
/* publication: copies a result to output.directory of its job, in a thread, because that directory may be
 * slow.
 *
 * The copy is made before the result moves to results/. If it fails, the job fails with the error of the
 * copy. After a crash at any point, either the result in results/ has been copied, or the task gets another
 * attempt. The temporary file of a copy is noted in the queue before it is created (queue_note_copy); the end
 * of the attempt deletes the note. After a crash, the next start removes the noted files
 * (service/results/output_cleanup).
 */
#ifndef HEXAD_SERVICE_RESULTS_PUBLICATION_H
#define HEXAD_SERVICE_RESULTS_PUBLICATION_H

#include "service/results/output_place.h"

typedef struct publication publication;

/* The name (without directory) of the temporary file for a copy of the result in this attempt's directory, to
 * be freed. */
char *publication_temporary(const char *from);

/* Begins output_place_copy of the result in the attempt's directory `from`. At the end of the copy, 1 is
 * written to the eventfd `end_fd`. The place must outlive the publication; texts are copied. Never NULL. If
 * no thread can be started, the copy is made before the call returns. */
publication *publication_start(output_place *outputs, const char *user, const char *from,
                               const char *directory, int frame, int end_fd);

/* Whether the copy has ended. Does not wait. */
bool publication_has_ended(const publication *p);

/* Waits for the end of the copy, frees, and returns whether the copy succeeded. Errors: those of
 * output_place_copy. */
bool publication_end(publication *p, error *e);

#endif
