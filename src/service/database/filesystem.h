// SPDX-License-Identifier: Apache-2.0
/* filesystem: checks that SQLite can be used safely on the file system of a directory.
 *
 * Private to src/service/database. Network file systems do not guarantee locks and flushes, and WAL needs
 * shared memory.
 */
#ifndef HEXAD_SERVICE_DATABASE_FILESYSTEM_H
#define HEXAD_SERVICE_DATABASE_FILESYSTEM_H

#include <stdbool.h>
#include <stdint.h>

#include "base/core/error.h"

/* The name of a network file system by the f_type of statfs(2). NULL for any other file system. */
const char *filesystem_network_name(uint64_t type);

/* Checks that the directory is not on a network file system. Otherwise returns false and an error. */
bool filesystem_check(const char *directory, error *e);

#endif
