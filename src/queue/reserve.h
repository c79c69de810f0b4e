/* reserve: room on the disk that is set aside for the database's log (SQLite's WAL).
 *
 * Private to src/queue. A full disk must not keep jobs from being cancelled, deleted and ended, so the log has its
 * blocks before it needs them: `reserve` in the state directory is a second name of the file queue.db-wal, with as
 * many bytes allocated as were asked for (fallocate) and what the log usually takes. SQLite removes its name when the queue is closed; the other one
 * keeps the blocks, and the next start gives the file back to SQLite, emptied. Nobody else can take them meanwhile,
 * as they could from a file that is deleted when room is needed.
 */
#ifndef HEXAD_QUEUE_RESERVE_H
#define HEXAD_QUEUE_RESERVE_H

#include <stdbool.h>
#include <stdint.h>

/* Before the database in the directory is opened: what was set aside becomes its log, unless there is one. */
void reserve_lend(const char *state_dir);

/* After it was opened: allocates so many bytes for the log besides what it usually takes; 0: none are. False, after a warning in the log,
 * when that cannot be. */
bool reserve_keep(const char *state_dir, int64_t bytes);

#endif
