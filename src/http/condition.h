/* condition: the headers by which a request depends on what the client has already (RFC 9110, 13 and 14).
 * No state; any thread. */
#ifndef HEXAD_HTTP_CONDITION_H
#define HEXAD_HTTP_CONDITION_H

#include <stdbool.h>
#include <stdint.h>

/* Whether the list of an If-Match or If-None-Match names the tag, which comes with its quotes; `*` names any.
 * Weak tags (W/) match when `weakly`. */
bool condition_names(const char *list, const char *tag, bool weakly);

typedef enum condition_range { CONDITION_WHOLE, CONDITION_PART, CONDITION_UNSATISFIABLE } condition_range;

/* The part of `bytes` bytes that a Range header asks for. Whole: none (NULL), several, or not understood, which is
 * to be ignored. */
condition_range condition_read_range(const char *range, int64_t bytes, int64_t *first, int64_t *count);

#endif
