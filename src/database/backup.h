/* backup: complete copies of the database, and checks of such copies.
 *
 * A copy is one file without a write-ahead log. The sqlite3 program can read it, and it can replace queue.db. Any
 * thread.
 */
#ifndef HEXAD_DATABASE_BACKUP_H
#define HEXAD_DATABASE_BACKUP_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/error.h"

struct database; /* database/database.h */

/* Copies the open database into a file that is empty or does not exist. The copy contains every change that was
 * acknowledged before the call. Reads and changes of the database do not wait for it, but the log keeps all changes
 * until the copy is complete. The copy is neither flushed to disk nor checked. Damage that two copies show is recorded in the database's health. An
 * error (storage_full) when less than `free_bytes` would stay free on the disk. */
bool backup_make(struct database *d, const char *path, int64_t free_bytes, error *e);

/* Makes a copy in the state directory, checks it like backup_check, and removes it. A copy that shows damage is made
 * and checked a second time. False when no copy could be checked; the error is database_damaged when the database is
 * too damaged to be copied. */
bool backup_make_checked(struct database *d, int64_t free_bytes, bool full, char **findings, error *e);

/* Makes such a copy in the state directory and returns a descriptor at its beginning. The file is already unlinked.
 * -1 on failure. */
int backup_open(struct database *d, int64_t free_bytes, int64_t *bytes, error *e);

/* Copies the database of a directory that no daemon uses. The caller holds its lock (database/lock.h). The directory is
 * not changed. */
bool backup_make_idle(const char *state_dir, const char *path, error *e);

/* Checks a whole copy: its pages, and the constraints of its tables. With `full` also that indexes match their
 * tables, that references are valid, and that the schema is complete. *findings has one line per fault (at most a
 * hundred), is "" without faults, and is to be freed. False when the file cannot be read, or (cancelled) when *stop
 * became true. `stop` may be NULL. */
bool backup_check(const char *path, bool full, const atomic_bool *stop, char **findings, error *e);

/* The id of the service instance (table `instance`) that a copy belongs to, to be freed; "" if it has none. NULL when the file
 * cannot be read. */
char *backup_read_instance(const char *path, error *e);

#endif
