/* header: checks the header of the database file against the file's length, before SQLite opens it.
 *
 * Private to src/queue. The check is needed because SQLite reads a truncated file as if it ended with zeros.
 */
#ifndef HEXAD_QUEUE_HEADER_H
#define HEXAD_QUEUE_HEADER_H

#include <stdbool.h>

#include "base/error.h"

/* An error (database_damaged) when the file is not a database, or its length does not fit its header. A missing or empty
 * file passes. A file with a write-ahead log passes, too, because the log may hold newer pages. */
bool header_check(const char *path, error *e);

#endif
