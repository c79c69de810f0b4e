/* fetches: which files of results their owners have been sent, until a result is complete.
 *
 * A result counts as delivered when its owner has been sent each of its files. What was sent of incomplete results is kept
 * in memory only, and of so many results at most; the one that was sent to longest ago is forgotten first. So a client
 * that fetches some files before a restart of the daemon has to fetch them again. Any thread.
 */
#ifndef HEXAD_RESULTS_FETCHES_H
#define HEXAD_RESULTS_FETCHES_H

#include <stdbool.h>
#include <stddef.h>

#include "base/ulid.h"

#define FETCHES_MOST 4096

typedef struct fetches fetches;

typedef struct fetches_result {
    char id[ULID_SIZE];
    int frame; /* or QUEUE_NO_FRAME */
} fetches_result;

fetches *fetches_new(void);
void fetches_free(fetches *f); /* accepts NULL */

/* File `index` of the `count` files of a result was sent. True when that was the last one. */
bool fetches_note(fetches *f, const fetches_result *of, size_t index, size_t count);

#endif
