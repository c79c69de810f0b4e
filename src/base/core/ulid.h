// SPDX-License-Identifier: Apache-2.0
/* ulid: identifiers that sort by creation time.
 *
 * 48 bits of wall-clock milliseconds and 80 random bits as 26 characters of Crockford's base 32, in lower
 * case (https://github.com/ulid/spec). Any thread.
 */
#ifndef HEXAD_BASE_CORE_ULID_H
#define HEXAD_BASE_CORE_ULID_H

#include <stdbool.h>
#include <stdint.h>

#define ULID_SIZE 27                                     /* including the final NUL */
#define ULID_ALPHABET "0123456789abcdefghjkmnpqrstvwxyz" /* in order of the digits */

void ulid_make(int64_t wall_ms, char text[ULID_SIZE]);

/* The wall-clock time of a valid ULID, below 2^48. */
int64_t ulid_time_ms(const char *text);

/* Whether the text is a well-formed ULID. */
bool ulid_is_valid(const char *text);

#endif
