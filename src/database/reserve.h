/* reserve: disk space that is reserved for the database's log (SQLite's WAL).
 *
 * Private to src/database. Jobs must still be cancelled, deleted and ended when the disk is full, so the log gets its
 * blocks before it needs them. The file `reserve` in the state directory is a second hard link to queue.db-wal. The
 * file has the requested number of bytes allocated (fallocate), plus what the log usually takes. SQLite unlinks
 * queue.db-wal when the queue is closed; the second link keeps the blocks. The next start empties the file and gives
 * it back to SQLite. No other program can take the blocks meanwhile, as it could from a file that is deleted when
 * space is needed.
 */
#ifndef HEXAD_DATABASE_RESERVE_H
#define HEXAD_DATABASE_RESERVE_H

#include <stdbool.h>
#include <stdint.h>

/* Call it before the database is opened: the reserved file becomes its log, unless there is a log already. */
void reserve_lend(const char *state_dir);

/* Call it after the database was opened: allocates `bytes` for the log, in addition to what it usually takes. 0: no
 * reserve. False, after a warning in the service's log, when the space cannot be allocated. */
bool reserve_keep(const char *state_dir, int64_t bytes);

#endif
