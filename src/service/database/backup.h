// SPDX-License-Identifier: Apache-2.0
/* backup: complete copies of the database, and checks of such copies.
 *
 * A copy is one file without a write-ahead log. The sqlite3 program can read it, and it can replace queue.db.
 * Any thread.
 */
#ifndef HEXAD_SERVICE_DATABASE_BACKUP_H
#define HEXAD_SERVICE_DATABASE_BACKUP_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/core/error.h"

struct database; /* service/database/database.h */

/* Copies the open database to a file that is empty or does not exist. The copy has every change that was
 * acknowledged before the call. Reads and changes of the database do not wait for it, but the log keeps all
 * changes until the copy is complete. The copy is neither flushed to disk nor checked. Damage that occurs in
 * two copies is recorded in the database's health. Errors: storage_full (less than `free_bytes` would remain
 * free on the disk), database_damaged, internal. */
bool backup_make(struct database *d, const char *path, int64_t free_bytes, error *e);

/* Makes a copy in the state directory, checks it like backup_check, and removes it. A copy with damage is
 * made and checked a second time. False if no copy could be checked; the error is database_damaged if the
 * database is too damaged to be copied. */
bool backup_make_checked(struct database *d, int64_t free_bytes, bool full, char **findings, error *e);

/* Makes such a copy in the state directory and returns a descriptor at its start; the caller closes it. The
 * file is already unlinked. -1: failure. */
int backup_open(struct database *d, int64_t free_bytes, int64_t *bytes, error *e);

/* Copies the database of a directory that no daemon uses. The caller holds its lock
 * (service/database/lock.h). The directory is not changed. */
bool backup_make_idle(const char *state_dir, const char *path, error *e);

/* Checks a whole copy: its pages, and the constraints of its tables. With `full` also that indexes match
 * their tables, that references are valid, and that the schema is complete. *findings has one line per fault
 * (at most a hundred) and is "" without faults; the caller frees it. False if the file cannot be read, or
 * (cancelled) if *stop became true. `stop` may be NULL. */
bool backup_check(const char *path, bool full, const atomic_bool *stop, char **findings, error *e);

/* The id of the service instance (table `instance`) of a copy; "" if it has none. The caller frees it. NULL
 * if the file cannot be read. */
char *backup_read_instance(const char *path, error *e);

#endif
