// SPDX-License-Identifier: Apache-2.0
/* backup_directory: the directory in the state directory where copies of the database are made. It is emptied
 * at each start. */
#ifndef HEXAD_SERVICE_DATABASE_BACKUP_DIRECTORY_H
#define HEXAD_SERVICE_DATABASE_BACKUP_DIRECTORY_H

#include <stdbool.h>

#include "base/core/error.h"

/* The path of the directory; the caller frees it. */
char *backup_directory_path(const char *state_dir);

/* Creates the directory if it does not exist. If root creates it, it gets the owner of the state directory.
 * Error: internal. */
bool backup_directory_make(const char *state_dir, error *e);

#endif
