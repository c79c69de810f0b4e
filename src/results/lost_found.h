/* lost_found: moves files and directories that the queue does not know to the directory lost+found.
 *
 * Nothing unknown is deleted. It is renamed to lost+found/results or lost+found/attempts and stays there until an
 * administrator removes it or moves it back. No state. Called at a start, by one thread.
 */
#ifndef HEXAD_RESULTS_LOST_FOUND_H
#define HEXAD_RESULTS_LOST_FOUND_H

#include <stdbool.h>

#include "base/error.h"

#define LOST_FOUND_DIRECTORY "lost+found"

/* Moves "WORK_DIR/PART/NAME" to "WORK_DIR/lost+found/PART/NAME", or to NAME~1, NAME~2, ... where that is taken. A
 * symbolic link is moved itself. lost_found_flush makes the move durable. */
bool lost_found_move(const char *work_dir, const char *part, const char *name, error *e);

/* Flushes the directory entries of PART in both places to disk. */
bool lost_found_flush(const char *work_dir, const char *part, error *e);

#endif
