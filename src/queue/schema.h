/* schema: the tables of the queue's database, and their version.
 *
 * The version is SQLite's user_version. A database without tables is given them, one of an older version
 * is carried over; one of a newer version is refused, since writing to it could lose what that version
 * keeps there.
 */
#ifndef HEXAD_QUEUE_SCHEMA_H
#define HEXAD_QUEUE_SCHEMA_H

#include <stdio.h>

#include <sqlite3.h>

#include "base/error.h"

#define SCHEMA_VERSION 5

#define SCHEMA_FINAL_STATES "'succeeded', 'failed', 'cancelled', 'timed_out'"

/* Of a job: a task of it may be started, as far as the job goes. Of one in order a task that runs, or waits
 * before it is tried again, keeps those behind it waiting. */
#define SCHEMA_CLAIMABLE \
    "ready > 0 AND pending = 0 AND is_paused = 0 AND (is_ordered = 0 OR running + delayed = 0)"

/* Makes or carries over the tables, and holds them against what they have to be. What cannot be read, or is not as it
 * has to be, is an error with code database_damaged that tells what and the way out. */
bool schema_prepare(sqlite3 *database, error *e);

/* Whether the tables, their columns and the indexes are those of this version. Writes a line for each that is not, and
 * counts them. False when that could not be found out. */
bool schema_compare(sqlite3 *database, FILE *findings, int *count, error *e);

/* Whether the result code of a call of SQLite's means that what is stored is damaged; and whether it means that a
 * file could not be read, which may be damage. */
bool schema_code_is_damage(int code);
bool schema_code_is_doubt(int code);

#endif
