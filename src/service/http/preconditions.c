// SPDX-License-Identifier: Apache-2.0
#include "service/http/preconditions.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

bool preconditions_match(const char *list, const char *tag)
{
    size_t length = strlen(tag);
    while (*list) {
        list += strspn(list, " \t,");
        if (*list == '*') return true;
        if (strncmp(list, "W/", 2) == 0) list += 2;
        if (*list != '"') return false;
        const char *end = strchr(list + 1, '"');
        if (!end) return false;
        if ((size_t)(end + 1 - list) == length && memcmp(list, tag, length) == 0) return true;
        list = end + 1;
    }
    return false;
}

/* Parses a number of bytes. If it has too many digits, strtoll returns the largest number, which is beyond
 * every end. */
static bool read_digits(const char **text, int64_t *value)
{
    size_t length = strspn(*text, "0123456789");
    if (length == 0) return false;
    *value = strtoll(*text, NULL, 10);
    *text += length;
    return true;
}

preconditions_range preconditions_read_range(const char *range, int64_t bytes, int64_t *first, int64_t *count)
{
    int64_t low = 0, high = bytes - 1;
    if (!range || strncasecmp(range, "bytes=", 6) != 0) return PRECONDITIONS_WHOLE;
    range += 6;
    bool has_low = read_digits(&range, &low);
    if (*range++ != '-') return PRECONDITIONS_WHOLE;
    bool has_high = read_digits(&range, &high);
    if (*range || (!has_low && !has_high) || (has_low && has_high && low > high)) return PRECONDITIONS_WHOLE;
    if (!has_low) { /* the last `high` bytes */
        if (high == 0) return PRECONDITIONS_UNSATISFIABLE;
        low = high < bytes ? bytes - high : 0;
        high = bytes - 1;
    }
    if (low >= bytes) return PRECONDITIONS_UNSATISFIABLE;
    *first = low;
    *count = (high < bytes ? high + 1 : bytes) - low;
    return PRECONDITIONS_PART;
}
