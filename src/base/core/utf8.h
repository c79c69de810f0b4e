// SPDX-License-Identifier: Apache-2.0
/* utf8: one character of UTF-8. Pure functions, any thread. */
#ifndef HEXAD_BASE_CORE_UTF8_H
#define HEXAD_BASE_CORE_UTF8_H

#include <stddef.h>
#include <stdint.h>

/* Decodes the character at the beginning of `length` bytes, which may be a surrogate. Returns its number of
 * bytes; 0: the first byte begins none. */
size_t utf8_decode(const unsigned char *s, size_t length, uint32_t *code);

/* Writes a character. Returns its number of bytes, 1 to 4. */
size_t utf8_encode(uint32_t code, char *out);

/* The number of characters of a text. */
size_t utf8_count(const char *text);

#endif
