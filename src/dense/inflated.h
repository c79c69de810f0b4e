/* inflated: the bytes that zlib packed into a file, as a zlib stream or as gzip files after one another. */
#ifndef HEXAD_DENSE_INFLATED_H
#define HEXAD_DENSE_INFLATED_H

#include <stdint.h>

typedef struct inflated inflated;

/* Opens the data of the file from `offset` on. `fd` is read with pread only, and remains the caller's. */
inflated *inflated_new(int fd, int64_t offset);
void inflated_free(inflated *i); /* accepts NULL */

/* The next bytes, fewer than `count` only at the end; -1: they cannot be read, or were not packed so. */
int64_t inflated_read(inflated *i, void *to, int64_t count);

/* To the first byte again. */
void inflated_rewind(inflated *i);

#endif
