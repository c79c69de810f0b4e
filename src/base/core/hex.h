// SPDX-License-Identifier: Apache-2.0
/* hex: hexadecimal digits, and texts of URIs, which may be percent-encoded. Pure functions; any thread. */
#ifndef HEXAD_BASE_CORE_HEX_H
#define HEXAD_BASE_CORE_HEX_H

#include <stdbool.h>
#include <stddef.h>
#include <string.h>

/* -1: it is none. */
static inline int hex_digit(char c)
{
    static const char digits[] = "0123456789abcdef0123456789ABCDEF";
    const char *found = c ? strchr(digits, c) : NULL;
    return found ? (int)(found - digits) % 16 : -1;
}

/* The byte of two digits; -1: they are none. */
static inline int hex_byte(const char *at)
{
    const int high = hex_digit(at[0]), low = high < 0 ? -1 : hex_digit(at[1]);
    return low < 0 ? -1 : 16 * high + low;
}

/* Reads two digits per byte. False: the text has others. */
static inline bool hex_read(const char *text, unsigned char *bytes, size_t count)
{
    for (size_t k = 0; k < count; k++) {
        const int byte = hex_byte(text + 2 * k);
        if (byte < 0) return false;
        bytes[k] = (unsigned char)byte;
    }
    return true;
}

/* Writes two digits per byte, and the end of the text. */
static inline void hex_print(const unsigned char *bytes, size_t count, char *text)
{
    static const char digits[] = "0123456789abcdef";
    for (size_t k = 0; k < 2 * count; k++) text[k] = digits[bytes[k / 2] >> (k % 2 ? 0 : 4) & 15];
    text[2 * count] = '\0';
}

/* The next character of a URI at *at. %00 is not decoded, since it would end the text. */
static inline char hex_next_of_uri(const char **at)
{
    const char first = *(*at)++;
    const int byte = first == '%' ? hex_byte(*at) : -1;
    if (byte <= 0) return first;
    *at += 2;
    return (char)byte;
}

#endif
