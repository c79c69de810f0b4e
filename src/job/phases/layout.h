// SPDX-License-Identifier: Apache-2.0
/* layout: the folders of the frames of a sequence, relative to one frame and to the folder that contains all.
 * They follow output.directory if it is given; otherwise each frame is in a folder named by its number, as
 * clients fetch results.
 */
#ifndef HEXAD_JOB_PHASES_LAYOUT_H
#define HEXAD_JOB_PHASES_LAYOUT_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"

typedef struct layout {
    size_t count;
    int *frames;    /* ascending */
    char **folders; /* of each frame, relative to the folder of `frame`: "." or "../7" */
    char **below;   /* of each frame, relative to the folder that contains all: "./7" */
} layout;

/* `pattern`: output.directory, or NULL. Error: spec_invalid (a folder has a name that USD cannot quote). */
bool layout_make(const char *pattern, const int *frames, size_t count, int frame, layout *out, error *e);

void layout_free(layout *l); /* accepts a zeroed object */

#endif
