/* lost: the directory lost+found, which takes what stands in the state directory and belongs to nobody there.
 *
 * Nothing that the queue does not know is deleted: it is renamed to lost+found/results or lost+found/attempts and
 * stays there until an administrator removes it or moves it back. No state; the supervisor's thread, at a start.
 */
#ifndef HEXAD_EXECUTOR_LOST_H
#define HEXAD_EXECUTOR_LOST_H

#include <stdbool.h>

#include "base/error.h"

#define LOST_DIRECTORY "lost+found"

/* Moves "STATE_DIR/PART/NAME" to "STATE_DIR/lost+found/PART/NAME", or to NAME~1, NAME~2, ... where that is taken. A
 * symbolic link is moved itself. Not flushed to disk before lost_flush. */
bool lost_move(const char *state_dir, const char *part, const char *name, error *e);

/* Flushes the names of this part in both places. */
bool lost_flush(const char *state_dir, const char *part, error *e);

#endif
