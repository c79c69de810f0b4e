/* schema: the tables of the queue's database, and their version.
 *
 * The version is SQLite's user_version. A database without tables is given them, one of an older version
 * is carried over; one of a newer version is refused, since writing to it could lose what that version
 * keeps there.
 */
#ifndef HEXAD_QUEUE_SCHEMA_H
#define HEXAD_QUEUE_SCHEMA_H

#include <sqlite3.h>

#include "base/error.h"

#define SCHEMA_VERSION 5

#define SCHEMA_FINAL_STATES "'succeeded', 'failed', 'cancelled', 'timed_out'"

/* Of a job: a task of it may be started, as far as the job goes. Of one in order a task that runs, or waits
 * before it is tried again, keeps those behind it waiting. */
#define SCHEMA_CLAIMABLE                                                                                     \
    "ready > 0 AND pending = 0 AND is_paused = 0 AND (is_ordered = 0 OR running + delayed = 0)"

bool schema_prepare(sqlite3 *database, error *e);

#endif
