// SPDX-License-Identifier: Apache-2.0
/* frames: frame numbers of a sequence, and paths that contain one.
 *
 * "7", "1-100", "1-100x2" (every second), or several of these with commas: "1-10,20". Numbers are 0 ..
 * 999999999, each at most once. In a path the first `####` (the number of # is the minimum number of digits),
 * `%04d` (`%d`) or `$F4` (`$F`) is replaced by the number, and each repetition of the same notation behind it. Pure functions, any thread.
 */
#ifndef HEXAD_BASE_CORE_FRAMES_H
#define HEXAD_BASE_CORE_FRAMES_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"

/* Maximum number of frames, which are one task each. */
#define FRAMES_MOST 100000

/* Stands for the numbers of all existing files. The service replaces it by numbers. */
#define FRAMES_ALL "all"

/* The numbers in the given order; the caller frees them. Error: spec_invalid. */
int *frames_parse(const char *text, size_t *count, error *e);

/* The text of ascending numbers, which is short if they have equal steps; the caller frees it. */
char *frames_print(const int *numbers, size_t count);

/* The notations of the number, for messages. */
#define FRAMES_NOTATIONS "####, %04d or $F4"

bool frames_is_pattern(const char *path);

/* The path of one frame; the caller frees it. */
char *frames_path(const char *path, int frame);

/* The paths of several frames, which the caller frees, of a path with the place of a number. */
char **frames_paths(const char *pattern, const int *numbers, size_t count);

/* The number of characters before the frame number; the path must be a pattern. */
size_t frames_prefix(const char *pattern);

/* The number of characters of the longest directory prefix that all frames share, with its last slash; 0:
 * they share none. The path must be a pattern. */
size_t frames_shared(const char *pattern);

/* The directory that contains the directories of all frames; the caller frees it. NULL: the path is not a
 * pattern, or there is no such directory. */
char *frames_above(const char *pattern);

/* Whether the file with this name in the result of a frame belongs to all frames (WORKER_STAGE_ENDING). */
bool frames_is_stage(const char *name);

/* Whether `path` is the path of a frame, whose number is written to *frame. */
bool frames_match(const char *pattern, const char *path, int *frame);

#endif
