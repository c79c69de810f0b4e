// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/file_pattern.h"

#include <string.h>

bool file_pattern_is(const char *s)
{
    int conversions = 0;
    for (; *s; s++) {
        if (*s != '%') continue;
        size_t digits = strspn(s + 1, "0123456789");
        if (digits > 3 || (s[1 + digits] != 'd' && s[1 + digits] != 'u')) return false;
        s += 1 + digits;
        conversions++;
    }
    return conversions == 1;
}
