/* backup_directory: the directory in the state directory where copies of the database are made. It is emptied at each
 * start. */
#ifndef HEXAD_DATABASE_BACKUP_DIRECTORY_H
#define HEXAD_DATABASE_BACKUP_DIRECTORY_H

#include <stdbool.h>

#include "base/error.h"

/* To be freed. */
char *backup_directory_path(const char *state_dir);

/* Creates it if it does not exist. Created by root, it gets the owner of the state directory. Error: internal. */
bool backup_directory_make(const char *state_dir, error *e);

#endif
