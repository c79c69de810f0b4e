/* output_place: the directories of users that results are copied to (output.directory), and whose results are there.
 *
 * Copies into one directory take turns, so the files that the report in it lists are always those of one result. The queue
 * notes for whom a report was delivered into a directory. While that report is there, no job of another user may use the
 * directory, unless results are shared. Other daemons that write to the directory are not known here. Any thread.
 */
#ifndef HEXAD_RESULTS_OUTPUT_PLACE_H
#define HEXAD_RESULTS_OUTPUT_PLACE_H

#include <stdbool.h>

#include "base/error.h"
#include "queue/queue.h"
#include "store/output.h"

typedef struct output_place output_place;

/* The queue and what `outputs` points to must outlive the place. `share`: users may replace results of others. */
output_place *output_place_new(queue *q, const store_outputs *outputs, bool share);
void output_place_free(output_place *p); /* accepts NULL */

const store_outputs *output_place_roots(const output_place *p); /* NULL for NULL */

/* Whether a result of this user could be copied to the directory now. Makes and removes one hidden file in the nearest
 * directory that exists. A file system that does not answer counts as unwritable after 2 s. A disk that is full or fails is
 * no error: it may work when the job ends. Errors: path_forbidden, output_taken, output_unwritable. */
bool output_place_check(output_place *p, const char *user, const char *directory, error *e);

/* Whether the setting output_roots has changed since the start, which a restart applies. output_place_check says so of paths
 * outside of the roots. */
void output_place_note_change(output_place *p, bool changed);

/* Copies the result in the directory `from`. Waits for its turn. `temporary` names the file that a crash leaves. */
bool output_place_copy(output_place *p, const char *user, const char *from, const char *directory,
                       const char *temporary, error *e);

/* Looks whether results can be written below each of the roots, and logs a warning for each below which they cannot. Takes up
 * to 2 s for each. */
void output_place_check_roots(output_place *p);

/* What the last output_place_check_roots found: the first root that is not writable; NULL: all are. Lives as long as the
 * place. */
const char *output_place_unwritable(const output_place *p);

#endif
