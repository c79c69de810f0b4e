// SPDX-License-Identifier: Apache-2.0
/* hashed_stream: a stream that writes to a file and keeps a hash of each block written, so that the file can
 * be read from the disk again and compared.
 *
 * Each block is hashed in memory, before the system has its bytes. Formats that write a number into an
 * earlier place seek back. An earlier block is read again for this, and compared with its hash before it is
 * changed. One thread.
 */
#ifndef HEXAD_FILES_HASHED_STREAM_H
#define HEXAD_FILES_HASHED_STREAM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

/* Bytes of a block. The hashes of 1 GB take 8 MB of memory. */
enum { HASHED_STREAM_BLOCK = 4096 };

typedef struct hashed_stream hashed_stream;

/* Opens a stream that only writes. `fd` is an empty file open for reading and writing. Closing the stream
 * closes `fd` and frees *out. On failure returns NULL and sets errno; `fd` remains open. */
FILE *hashed_stream_open(int fd, hashed_stream **out);

int hashed_stream_descriptor(const hashed_stream *h);

/* For a flushed stream: number of bytes of the file as written. */
uint64_t hashed_stream_length(const hashed_stream *h);

/* For a flushed stream: whether these bytes were written as block `index`. The bytes of the last block are
 * followed by zeros up to the length of a block. */
bool hashed_stream_has(hashed_stream *h, size_t index, const unsigned char bytes[HASHED_STREAM_BLOCK]);

#endif
