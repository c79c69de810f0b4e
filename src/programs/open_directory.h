// SPDX-License-Identifier: Apache-2.0
/* open_directory: whether users other than that of the service can write to its directories. */
#ifndef HEXAD_PROGRAMS_OPEN_DIRECTORY_H
#define HEXAD_PROGRAMS_OPEN_DIRECTORY_H

/* Describes which other users can write to the directory, and the command that changes it. The caller frees
 * the text. NULL: no other user can, or the directory cannot be examined. A group counts unless it is that of
 * the process or the primary group of the directory's owner. */
char *open_directory_describe(const char *path);

#endif
