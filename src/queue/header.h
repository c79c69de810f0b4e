/* header: the first bytes of the database's file, held against its length, before SQLite is let at it.
 *
 * Private to src/queue. SQLite itself reads a file that was cut off as if it ended with zeros.
 */
#ifndef HEXAD_QUEUE_HEADER_H
#define HEXAD_QUEUE_HEADER_H

#include <stdbool.h>

#include "base/error.h"

/* An error (database_damaged) when the file is not a database, or not as long as it says. A file that is missing or
 * empty passes, and so does one with a write-ahead log, which may hold better than what stands in the file. */
bool header_check(const char *path, error *e);

#endif
