// SPDX-License-Identifier: Apache-2.0
/* preconditions: evaluates the headers If-None-Match and Range, which state what the client already
 * has (RFC 9110, 13 and 14). No state; any thread.
 */
#ifndef HEXAD_SERVICE_HTTP_PRECONDITIONS_H
#define HEXAD_SERVICE_HTTP_PRECONDITIONS_H

#include <stdbool.h>
#include <stdint.h>

/* Whether the list of an If-None-Match contains the tag, which includes its quotes. `*` matches every tag, and a
 * weak tag (W/) the same one. */
bool preconditions_match(const char *list, const char *tag);

typedef enum preconditions_range {
    PRECONDITIONS_WHOLE,
    PRECONDITIONS_PART,
    PRECONDITIONS_UNSATISFIABLE
} preconditions_range;

/* The part of `bytes` bytes that a Range header requests. PRECONDITIONS_WHOLE: there is no header (NULL), it
 * requests several parts, or it is malformed and must be ignored (RFC 9110). */
preconditions_range preconditions_read_range(const char *range, int64_t bytes, int64_t *first,
                                             int64_t *count);

#endif
