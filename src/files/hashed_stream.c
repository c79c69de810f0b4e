// SPDX-License-Identifier: Apache-2.0
#include "files/hashed_stream.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <nettle/sha2.h>

#include "base/core/memory.h"
#include "base/core/transfer.h"

enum { BLOCK = HASHED_STREAM_BLOCK };

typedef struct digest {
    uint8_t bytes[SHA256_DIGEST_SIZE];
} digest;

struct hashed_stream {
    int fd;
    int cause;              /* errno of the first failure to write, which all later ones repeat; 0: none */
    uint64_t at, length;    /* position of the stream; bytes of the file */
    size_t count, capacity; /* blocks with a digest, all before the current one */
    digest *digests;
    size_t current;             /* index of the block in `block`; its digest may be out of date */
    unsigned char block[BLOCK]; /* zero beyond the end of the file */
};

static digest digest_of(const unsigned char block[BLOCK])
{
    struct sha256_ctx context;
    digest d;
    sha256_init(&context);
    sha256_update(&context, BLOCK, block);
    sha256_digest(&context, sizeof d.bytes, d.bytes);
    return d;
}

static bool is_same(const digest *a, const digest *b)
{
    return memcmp(a->bytes, b->bytes, sizeof a->bytes) == 0;
}

/* Stores the digest of the current block. */
static void store_digest(hashed_stream *h)
{
    if (h->current == h->capacity) {
        h->capacity = 2 * h->capacity + 16;
        h->digests = mem_resize(h->digests, h->capacity * sizeof *h->digests);
    }
    h->digests[h->current] = digest_of(h->block);
    if (h->current == h->count) h->count++;
}

/* Makes a written block the current one. False: it is not as it was written, or cannot be read; errno is
 * set. */
static bool load_block(hashed_stream *h, size_t index)
{
    memset(h->block, 0, BLOCK);
    h->current = index;
    if (transfer_read_at(h->fd, h->block, BLOCK, (uint64_t)index * BLOCK) < 0) return false;
    const digest d = digest_of(h->block);
    errno = EIO;
    return is_same(&d, &h->digests[index]);
}

/* Makes a block the current one. Blocks that a seek forward omitted are zeros. */
static bool select_block(hashed_stream *h, size_t index)
{
    if (index == h->current) return true;
    store_digest(h);
    if (index < h->count) return load_block(h, index);
    memset(h->block, 0, BLOCK);
    for (h->current = h->count; h->current < index; h->current++) store_digest(h);
    return true;
}

static bool write_blocks(hashed_stream *h, const char *from, size_t count)
{
    for (size_t done = 0, part; done < count; done += part) {
        const uint64_t at = h->at + done;
        const size_t within = at % BLOCK;
        part = count - done < BLOCK - within ? count - done : BLOCK - within;
        if (!select_block(h, at / BLOCK)) return false;
        memcpy(h->block + within, from + done, part);
    }
    return transfer_write_at(h->fd, from, count, h->at);
}

static ssize_t on_write(void *cookie, const char *from, size_t count)
{
    hashed_stream *h = cookie;
    errno = h->cause;
    if (h->cause || !write_blocks(h, from, count)) {
        h->cause = errno ? errno : EIO;
        return 0;
    }
    h->at += count;
    if (h->at > h->length) h->length = h->at;
    return (ssize_t)count;
}

static int on_seek(void *cookie, off64_t *to, int whence)
{
    hashed_stream *h = cookie;
    const uint64_t from = whence == SEEK_SET ? 0 : whence == SEEK_CUR ? h->at : h->length;
    const off64_t at = (off64_t)from + *to;
    if (at < 0) {
        errno = EINVAL;
        return -1;
    }
    h->at = (uint64_t)at;
    *to = at;
    return 0;
}

static int on_close(void *cookie)
{
    hashed_stream *h = cookie;
    const int closed = close(h->fd);
    free(h->digests);
    free(h);
    return closed;
}

FILE *hashed_stream_open(int fd, hashed_stream **out)
{
    const cookie_io_functions_t functions = {.write = on_write, .seek = on_seek, .close = on_close};
    hashed_stream *h = mem_alloc(sizeof *h);
    h->fd = fd;
    FILE *stream = fopencookie(h, "wb", functions);
    if (stream)
        *out = h;
    else
        free(h);
    return stream;
}

int hashed_stream_descriptor(const hashed_stream *h)
{
    return h->fd;
}

uint64_t hashed_stream_length(const hashed_stream *h)
{
    return h->length;
}

bool hashed_stream_has(hashed_stream *h, size_t index, const unsigned char bytes[BLOCK])
{
    if (index == h->current) store_digest(h);
    const digest d = digest_of(bytes);
    return index < h->count && is_same(&d, &h->digests[index]);
}
