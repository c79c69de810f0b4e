/* preconditions: the headers If-Match, If-None-Match and Range, by which an answer depends on what the client
 * has already (RFC 9110, 13 and 14). No state; any thread. */
#ifndef HEXAD_HTTP_PRECONDITIONS_H
#define HEXAD_HTTP_PRECONDITIONS_H

#include <stdbool.h>
#include <stdint.h>

/* Whether the list of an If-Match or If-None-Match contains the tag, given with its quotes; `*` matches every
 * tag. Weak tags (W/) match when `weakly`. */
bool preconditions_match(const char *list, const char *tag, bool weakly);

typedef enum preconditions_range {
    PRECONDITIONS_WHOLE,
    PRECONDITIONS_PART,
    PRECONDITIONS_UNSATISFIABLE
} preconditions_range;

/* The part of `bytes` bytes that a Range header requests. PRECONDITIONS_WHOLE: there is no header (NULL), it
 * requests several parts, or it is malformed; the RFC has it ignored. */
preconditions_range preconditions_read_range(const char *range, int64_t bytes, int64_t *first,
                                             int64_t *count);

#endif
