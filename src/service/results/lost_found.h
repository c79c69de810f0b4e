// SPDX-License-Identifier: Apache-2.0
/* lost_found: moves entries of results/ and attempts/ without a job in the queue to the directory lost+found.
 *
 * Such an entry is never deleted. It is renamed to lost+found/results/NAME or lost+found/attempts/NAME and
 * stays there until an administrator removes it or moves it back. No state. Called at a start, by one thread.
 */
#ifndef HEXAD_SERVICE_RESULTS_LOST_FOUND_H
#define HEXAD_SERVICE_RESULTS_LOST_FOUND_H

#include <stdbool.h>

#include "base/core/error.h"

#define LOST_FOUND_DIRECTORY "lost+found"

/* Renames "WORK_DIR/PART/NAME" to "WORK_DIR/lost+found/PART/NAME", or to NAME~1, NAME~2, ... if the name
 * exists there. A symbolic link is renamed, not followed. lost_found_flush makes the move durable. Errors:
 * internal; those of store_directory_create. */
bool lost_found_move(const char *work_dir, const char *part, const char *name, error *e);

/* Flushes "WORK_DIR/lost+found/PART" and "WORK_DIR/PART" to disk. Errors: those of store_directory_sync. */
bool lost_found_flush(const char *work_dir, const char *part, error *e);

#endif
