/* layout: where the frames of a sequence lie, seen from one of them: as output.directory places them, else as clients
 * fetch them, each in a folder of its number.
 */
#ifndef HEXAD_RUN_LAYOUT_H
#define HEXAD_RUN_LAYOUT_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"

typedef struct layout {
    size_t count;
    int *frames;    /* ascending */
    char **folders; /* of each, relative to that of the one: "." or "../7" */
} layout;

/* `pattern`: output.directory, or NULL. Error: spec_invalid where a folder has a name that USD has no quotes for. */
bool layout_make(const char *pattern, const int *frames, size_t count, int frame, layout *out, error *e);

void layout_free(layout *l); /* accepts an empty one */

#endif
