// SPDX-License-Identifier: Apache-2.0
/* base64: decodes bytes that a text holds as base64. Blanks are permitted anywhere. Pure functions; any
 * thread. */
#ifndef HEXAD_IO_MESHES_BASE64_H
#define HEXAD_IO_MESHES_BASE64_H

#include <stdbool.h>
#include <stddef.h>

/* Decodes `count` bytes to `to`. In the text they are one block of groups of four characters; the last group
 * may be padded with '='. *at is moved behind the block. False, *at unchanged: the text ends before (at
 * `end`), or has characters that are not base64. */
bool base64_read(const char **at, const char *end, unsigned char *to, size_t count);

/* The number of bytes that the text at .. end encodes: three for each group of four characters, less the
 * padding. Blanks do not count. */
size_t base64_count(const char *at, const char *end);

#endif
