// SPDX-License-Identifier: Apache-2.0
/* inflated: reads bytes that are compressed with zlib in a file: a zlib stream, or consecutive gzip files. */
#ifndef HEXAD_IO_VOLUMES_INFLATED_H
#define HEXAD_IO_VOLUMES_INFLATED_H

#include <stdint.h>

typedef struct inflated inflated;

/* Opens the data of the file, beginning at `offset`. `fd` is read with pread only, and remains the
 * caller's. */
inflated *inflated_new(int fd, int64_t offset);
void inflated_free(inflated *i); /* accepts NULL */

/* Reads the next bytes. Returns their number, which is less than `count` only at the end; -1: they cannot be
 * read or are not valid. */
int64_t inflated_read(inflated *i, void *to, int64_t count);

/* Returns to the first byte. */
void inflated_rewind(inflated *i);

#endif
