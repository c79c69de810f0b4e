// SPDX-License-Identifier: Apache-2.0
/* output_place: copies results to directories of users (output.directory) and checks whether a user may use a
 * directory.
 *
 * Copies into one directory run one after another, so the report in a directory and the files that it lists
 * always belong to one result. The queue stores for which user a report was delivered to a directory. While
 * this report exists, jobs of other users may not use the directory, unless `share` is set. Writes by other
 * daemons are not coordinated. Any thread.
 */
#ifndef HEXAD_SERVICE_RESULTS_OUTPUT_PLACE_H
#define HEXAD_SERVICE_RESULTS_OUTPUT_PLACE_H

#include <stdbool.h>

#include "base/core/error.h"
#include "service/queue/queue.h"
#include "files/output.h"

typedef struct output_place output_place;

/* The queue, `outputs` and what it points to must outlive the place. `share`: users may replace results of
 * other users. */
output_place *output_place_new(queue *q, const store_outputs *outputs, bool share);
void output_place_free(output_place *p); /* accepts NULL */

const store_outputs *output_place_roots(const output_place *p); /* NULL for NULL */

/* Whether a result of this user could be copied to the directory now. Creates and removes one hidden file in
 * the nearest existing parent directory. A file system that does not respond within 2 s counts as unwritable.
 * A full or failing disk is not an error, since it may work when the job ends. Errors: path_forbidden,
 * output_taken, output_unwritable. */
bool output_place_check(output_place *p, const char *user, const char *directory, error *e);

/* Records whether the setting output_roots has changed since the start; a restart applies the change. The
 * errors of output_place_check for paths outside of the roots mention it. */
void output_place_note_change(output_place *p, bool changed);

/* The directory of a task's copy, to be freed: `directory` is output.directory of its job, with the place of
 * the frame number unless the frame is QUEUE_NO_FRAME. */
char *output_place_directory(const char *directory, int frame);

/* The name of the temporary file of a copy, to be freed. No other copy may have this text. */
char *output_place_temporary(const char *unique);

/* Copies the result of a task in the directory `from` to output_place_directory(directory, frame), after
 * other copies to it have ended. Files that belong to all frames of a sequence (WORKER_STAGE_ENDING) are
 * copied to the directory above the directories of all frames instead; they are not copied if there is none,
 * or if it is not below an output root. `temporary` is the name of the temporary file; a crash may leave it
 * there. Errors, which name output.directory: those of result_read, store_output_open, store_output_copy
 * and the queue; output_taken. input_damaged: the result itself is damaged or incomplete. */
bool output_place_copy(output_place *p, const char *user, const char *from, const char *directory, int frame,
                       const char *temporary, error *e);

/* Checks whether files can be written below each root, and logs a warning for each root where they cannot.
 * Takes up to 2 s per root. */
void output_place_check_roots(output_place *p);

/* The first root that was not writable at the last output_place_check_roots; NULL: all were, or no check has
 * run. Borrowed from the `outputs` of the place. */
const char *output_place_unwritable(const output_place *p);

#endif
