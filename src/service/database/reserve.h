// SPDX-License-Identifier: Apache-2.0
/* reserve: disk space that is reserved for the database's log (SQLite's WAL).
 *
 * Private to src/service/database. Jobs must still be cancelled, deleted and ended if the disk is full, so
 * that blocks of the log are allocated in advance. The file `reserve` in the state directory is a second hard
 * link to queue.db-wal. The requested number of bytes, plus the usual size of the log, is allocated
 * (fallocate). SQLite unlinks queue.db-wal when the queue is closed; the second link keeps the blocks. The
 * next start clears the file and returns it to SQLite. No other program can take the blocks in between,
 * unlike those of a file that is deleted when space is needed.
 */
#ifndef HEXAD_SERVICE_DATABASE_RESERVE_H
#define HEXAD_SERVICE_DATABASE_RESERVE_H

#include <stdbool.h>
#include <stdint.h>

/* Call it before the database is opened: the reserved file becomes its log, unless there is one. */
void reserve_lend(const char *state_dir);

/* Call it after the database was opened: allocates `bytes` for the log, in addition to its usual size. 0: no
 * reserve. False, after a logged warning: the space cannot be allocated. */
bool reserve_keep(const char *state_dir, int64_t bytes);

#endif
