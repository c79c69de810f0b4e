/* backup: whole copies of a queue's database, and what a check finds in one.
 *
 * A copy is one file without a write-ahead log beside it, which SQLite's own program reads, and which can be put in the
 * place of queue.db. Any thread.
 */
#ifndef HEXAD_QUEUE_BACKUP_H
#define HEXAD_QUEUE_BACKUP_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/error.h"
#include "queue/queue.h"

/* Copies the database of an open queue into a file that is empty or not there; what was acknowledged before the call is in
 * it. The queue is used meanwhile: it is held for a fraction of a millisecond at a time. Neither flushed to disk nor checked.
 * Damage that SQLite notices is noted in the queue's health. An error (storage_full) when less than `free_bytes` would be
 * left on the disk. */
bool backup_make(queue *q, const char *path, int64_t free_bytes, error *e);

/* Makes a copy in the state directory, checks it as backup_check does, and removes it. Damage that two copies show is damage
 * of the database. False when no copy could be checked: with the error database_damaged when it cannot be copied. */
bool backup_make_checked(queue *q, int64_t free_bytes, bool full, char **findings, error *e);

/* Such a copy in the state directory, as a descriptor at its beginning; the file has no name any more. */
int backup_open(queue *q, int64_t free_bytes, int64_t *bytes, error *e);

/* The same of a directory that no daemon uses, whose lock the caller holds (queue/lock.h); changes nothing there. */
bool backup_make_idle(const char *state_dir, const char *path, error *e);

/* Reads all of a copy: its pages, and that rows keep what the tables promise; if `full` also that indexes hold what the
 * tables hold, references, and that all tables are there. *findings are lines, one for each fault (a hundred at most), "" when
 * there is none, to be freed. False when the file cannot be read, or (cancelled) when the flag was raised meanwhile;
 * `stop` may be NULL. */
bool backup_check(const char *path, bool full, const atomic_bool *stop, char **findings, error *e);

/* A queue in a copy, to be read; of an older version it is carried over first. */
queue *backup_open_queue(const char *path, error *e);

/* The directory below the state directory where copies are made, which is emptied at each start; to be freed. */
char *backup_directory(const char *state_dir);
/* Makes it, if it is not there. Made by root it belongs to whom the state directory belongs. */
bool backup_make_directory(const char *state_dir, error *e);

#endif
