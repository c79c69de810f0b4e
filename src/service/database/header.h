// SPDX-License-Identifier: Apache-2.0
/* header: checks the header of the database file against the file's length, before SQLite opens it.
 *
 * The check is needed because SQLite reads a truncated file as if it ended with zeros.
 */
#ifndef HEXAD_SERVICE_DATABASE_HEADER_H
#define HEXAD_SERVICE_DATABASE_HEADER_H

#include <stdbool.h>

#include "base/core/error.h"

/* The database, in the state directory. */
#define DATABASE_FILE_NAME "queue.db"

/* Whether a database that is not empty exists; then database_open does not create one. */
bool header_exists(const char *state_dir);

/* Errors: database_damaged (the file is not a database, or its length does not match its header); internal
 * (schema_check_version). A missing or empty file passes. A file with a write-ahead log passes, too, because
 * the log may have newer pages. */
bool header_check(const char *path, error *e);

#endif
