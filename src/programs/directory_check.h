// SPDX-License-Identifier: Apache-2.0
/* directory_check: whether directories that settings name can be used. Called at a start, before anything is
 * created, and by --check-settings. The checks change nothing; messages begin with the name of the setting. */
#ifndef HEXAD_PROGRAMS_DIRECTORY_CHECK_H
#define HEXAD_PROGRAMS_DIRECTORY_CHECK_H

#include <stdbool.h>

#include "base/core/error.h"

/* Whether this process may read and write the directory or, if it does not exist, create it. */
bool directory_check_usable(const char *setting, const char *path, error *e);

/* Whether this process may create the file. */
bool directory_check_file(const char *setting, const char *path, error *e);

/* Describes which other users can write to the directory, and the command that changes it. The caller frees
 * the text. NULL: no other user can, or the directory cannot be examined. A group counts unless it is that of
 * the process or the primary group of the directory's owner. */
char *directory_check_describe_writers(const char *path);

/* Whether the directory itself contains the file, by their paths. */
bool directory_check_contains(const char *directory, const char *path);

#endif
