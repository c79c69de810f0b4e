// SPDX-License-Identifier: Apache-2.0
/* fetches: records which files of a result were sent to its owner, until all were sent.
 *
 * A result counts as delivered when each of its files has been sent to its owner. The records are in memory
 * only and cover at most FETCHES_MOST results; a further one replaces the least recently used. After a
 * restart of the daemon, or after such a replacement, files that were already sent must be sent again. Any
 * thread.
 */
#ifndef HEXAD_SERVICE_RESULTS_FETCHES_H
#define HEXAD_SERVICE_RESULTS_FETCHES_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/ulid.h"

#define FETCHES_MOST 4096 /* partly sent results that are recorded */

typedef struct fetches fetches;

typedef struct fetches_result {
    char id[ULID_SIZE];
    int frame; /* or QUEUE_NO_FRAME */
} fetches_result;

fetches *fetches_new(void);
void fetches_free(fetches *f); /* accepts NULL */

/* Records that file `index` < `count` of a result with `count` files was sent. True if all its files have
 * been sent now; the record is then removed. A changed `count` starts a new record. */
bool fetches_note(fetches *f, const fetches_result *of, size_t index, size_t count);

#endif
