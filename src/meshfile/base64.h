/* base64: bytes that a text holds as base64, with blanks anywhere. Pure functions; any thread. */
#ifndef HEXAD_MESHFILE_BASE64_H
#define HEXAD_MESHFILE_BASE64_H

#include <stdbool.h>
#include <stddef.h>

/* The next `count` bytes, which are a block of whole groups of four characters, padded; *at goes behind it. False: there are fewer before
 * `end`, or other characters. */
bool base64_read(const char **at, const char *end, unsigned char *to, size_t count);

/* Bytes that a text of whole groups holds. */
size_t base64_count(const char *at, const char *end);

#endif
