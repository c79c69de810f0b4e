// SPDX-License-Identifier: Apache-2.0
/* file_names: the files of a data set (queue.files), and the place of a name in input paths.
 *
 * In an input path, each `{file}` stands for the name of the frame's file. In a pattern, `*` stands for any
 * number of any characters except "/". Pure functions, any thread.
 */
#ifndef HEXAD_SPEC_FILE_NAMES_H
#define HEXAD_SPEC_FILE_NAMES_H

#include <stdbool.h>

#define FILE_NAMES_PLACE "{file}"

/* Whether the path has the place of a name. */
bool file_names_has_place(const char *path);

/* The path with the name in each place; the caller frees it. `name` NULL: a copy. */
char *file_names_path(const char *path, const char *name);

/* Whether the text has `*` in its last part, and in no other part. */
bool file_names_is_pattern(const char *text);

/* Whether the whole text, of `length` bytes, matches the pattern. Neither has a "/". */
bool file_names_match(const char *pattern, const char *text, int length);

#endif
