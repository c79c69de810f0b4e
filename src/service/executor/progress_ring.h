// SPDX-License-Identifier: Apache-2.0
/* progress_ring: the newest progress lines of all attempts, for clients that follow a job live.
 *
 * A ring buffer of PROGRESS_RING_LINES lines in memory. Lines are numbered in ascending order. Nothing is
 * stored on disk: a client that is slower than the ring, or connects after a restart, misses lines and
 * detects that by the numbers. Any thread.
 */
#ifndef HEXAD_SERVICE_EXECUTOR_PROGRESS_RING_H
#define HEXAD_SERVICE_EXECUTOR_PROGRESS_RING_H

#include <stddef.h>
#include <stdint.h>

#include "service/queue/queue.h"
#include "base/core/ulid.h"

/* An attempt reports at most ten times a second, so this holds six seconds of sixty attempts: about a
 * megabyte. */
#define PROGRESS_RING_LINES 4096

typedef struct progress_ring progress_ring;

typedef struct progress_ring_line {
    int64_t number;
    char id[ULID_SIZE]; /* of the job */
    char owner[QUEUE_OWNER_SIZE];
    int frame, attempt; /* frame is QUEUE_NO_FRAME if the job is not an array */
    char *text;         /* one JSON object */
} progress_ring_line;

progress_ring *progress_ring_new(void);
void progress_ring_free(progress_ring *r); /* accepts NULL */

void progress_ring_add(progress_ring *r, const char *id, const char *owner, int frame, int attempt,
                       const char *text);

/* Lists at most `limit` lines of the job `id` and of the jobs of `owner` (NULL: of all owners) with numbers
 * above `after`, oldest first. *newest is the value of `after` for the next call. The caller frees the lines
 * with progress_ring_lines_free. */
size_t progress_ring_list(progress_ring *r, const char *id, const char *owner, int64_t after, size_t limit,
                          progress_ring_line **lines, int64_t *newest);
void progress_ring_lines_free(progress_ring_line *lines, size_t count);

#endif
