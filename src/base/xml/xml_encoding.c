// SPDX-License-Identifier: Apache-2.0
/* Documents of XML in other encodings than UTF-8. */
#include "base/xml/xml.h"

#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/core/utf8.h"

enum { REPLACEMENT = 0xFFFD };

typedef enum encoding { UTF_8, UTF_16_LITTLE, UTF_16_BIG, ISO_8859_1, WINDOWS_1252 } encoding;

static encoding encoding_of(const char *data, size_t size)
{
    static const struct {
        const char *name;
        encoding is;
    } names[] = {{"ISO-8859-1", ISO_8859_1},
                 {"latin1", ISO_8859_1},
                 {"windows-1252", WINDOWS_1252},
                 {"cp1252", WINDOWS_1252}};
    if (size >= 2 && (memcmp(data, "\xFF\xFE", 2) == 0 || memcmp(data, "<\0", 2) == 0)) return UTF_16_LITTLE;
    if (size >= 2 && (memcmp(data, "\xFE\xFF", 2) == 0 || memcmp(data, "\0<", 2) == 0)) return UTF_16_BIG;
    const char *end = size > 5 && memcmp(data, "<?xml", 5) == 0 ? memchr(data, '>', size) : NULL;
    const char *at = end ? memmem(data, (size_t)(end - data), "encoding", 8) : NULL;
    if (!at) return UTF_8;
    at += 8 + strspn(at + 8, " \t\r\n=\"'");
    for (size_t k = 0; k < sizeof names / sizeof *names; k++) {
        const size_t length = strlen(names[k].name);
        if (strncasecmp(at, names[k].name, length) == 0 && strchr("\"'", at[length])) return names[k].is;
    }
    return UTF_8;
}

/* The character of a byte of windows-1252. */
static uint32_t of_windows(unsigned char byte)
{
    static const uint16_t upper[32] = {0x20AC, 0x81,   0x201A, 0x0192, 0x201E, 0x2026, 0x2020, 0x2021,
                                       0x02C6, 0x2030, 0x0160, 0x2039, 0x0152, 0x8D,   0x017D, 0x8F,
                                       0x90,   0x2018, 0x2019, 0x201C, 0x201D, 0x2022, 0x2013, 0x2014,
                                       0x02DC, 0x2122, 0x0161, 0x203A, 0x0153, 0x9D,   0x017E, 0x0178};
    return byte >= 0x80 && byte < 0xA0 ? upper[byte - 0x80] : byte;
}

static uint32_t unit_at(const unsigned char *at, bool is_big)
{
    return (uint32_t)(is_big ? at[0] << 8 | at[1] : at[1] << 8 | at[0]);
}

/* The character at *at, which moves behind it. Surrogates without their other half are replaced. */
static uint32_t next(const unsigned char **at, const unsigned char *end, encoding from)
{
    if (from == ISO_8859_1) return *(*at)++;
    if (from == WINDOWS_1252) return of_windows(*(*at)++);
    const uint32_t high = unit_at(*at, from == UTF_16_BIG);
    *at += 2;
    if (high < 0xD800 || high > 0xDFFF) return high;
    const uint32_t low = high < 0xDC00 && end - *at >= 2 ? unit_at(*at, from == UTF_16_BIG) : 0;
    if (low < 0xDC00 || low > 0xDFFF) return REPLACEMENT;
    *at += 2;
    return 0x10000 + ((high - 0xD800) << 10) + (low - 0xDC00);
}

char *xml_in_utf8(const char *data, size_t *size)
{
    enum { MOST = 3 /* bytes of UTF-8 for a unit */ };
    const encoding from = encoding_of(data, *size);
    const bool is_wide = from == UTF_16_LITTLE || from == UTF_16_BIG;
    if (from == UTF_8 || *size > SIZE_MAX / MOST - 1) return NULL;
    const char *appended = is_wide ? NULL : memmem(data, *size, "<AppendedData", 13);
    const size_t units = is_wide ? *size / 2 : *size;
    char *out = malloc(MOST * units + 1), *to = out;
    if (!out) return NULL;
    const unsigned char *at = (const unsigned char *)data, *end = appended
                                                                      ? (const unsigned char *)appended
                                                                      : at + (is_wide ? 2 * units : units);
    while (at < end) to += utf8_encode(next(&at, end, from), to);
    const size_t left = appended ? *size - (size_t)(appended - data) : 0;
    if (left > 0) memcpy(to, appended, left);
    to += left;
    *to = 0;
    *size = (size_t)(to - out);
    return out;
}
