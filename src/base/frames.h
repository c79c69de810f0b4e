/* frames: the numbers of a sequence, and paths that hold one.
 *
 * "7", "1-100", "1-100x2" (every second), or several of these with commas: "1-10,20". Numbers are 0 ..
 * 999999999, none twice. In a path the first `####` (as many digits at least as there are #) or `%04d`
 * (`%d`) stands for it. No state; any thread.
 */
#ifndef HEXAD_BASE_FRAMES_H
#define HEXAD_BASE_FRAMES_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"

/* A task each: more are several jobs. */
#define FRAMES_MOST 100000

/* The numbers in the order given, to be freed; NULL and an error (spec_invalid) that says what is wrong. */
int *frames_parse(const char *text, size_t *count, error *e);

bool frames_is_pattern(const char *path);

/* The path of one frame, to be freed. */
char *frames_path(const char *path, int frame);

#endif
