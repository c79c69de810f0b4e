// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/inflated.h"

#include <errno.h>
#include <limits.h>
#include <stdbool.h>
#include <stdlib.h>
#include <unistd.h>
#include <zlib.h>

#include "base/core/memory.h"

/* EITHER: zlib detects its own header or that of gzip */
enum { INPUT = 1 << 18, EITHER = MAX_WBITS + 32 };

struct inflated {
    int fd;
    int64_t start, at; /* `at`: offset of the first byte that is not in `input` */
    bool ended, broken;
    z_stream z;
    unsigned char input[INPUT];
};

inflated *inflated_new(int fd, int64_t offset)
{
    inflated *i = mem_alloc(sizeof *i);
    i->fd = fd;
    i->start = i->at = offset;
    i->ended = false;
    i->z = (z_stream){0};
    i->broken = inflateInit2(&i->z, EITHER) != Z_OK;
    return i;
}

void inflated_free(inflated *i)
{
    if (!i) return;
    inflateEnd(&i->z);
    free(i);
}

void inflated_rewind(inflated *i)
{
    i->at = i->start;
    i->z.avail_in = 0;
    i->ended = false;
    i->broken = inflateReset(&i->z) != Z_OK;
}

/* Reads more input. False: end of the file, or an error. */
static bool refill(inflated *i)
{
    ssize_t got;
    do got = pread(i->fd, i->input, INPUT, (off_t)i->at);
    while (got < 0 && errno == EINTR);
    if (got <= 0) return false;
    i->at += got;
    i->z.next_in = i->input;
    i->z.avail_in = (unsigned)got;
    return true;
}

/* Continues with the next gzip member, if another one follows. */
static void go_on(inflated *i)
{
    bool more = (i->z.avail_in > 0 || refill(i)) && i->z.next_in[0] == 0x1f;
    if (!more || inflateReset(&i->z) != Z_OK) i->ended = true;
}

int64_t inflated_read(inflated *i, void *to, int64_t count)
{
    int64_t done = 0;
    while (done < count && !i->ended && !i->broken) {
        unsigned step = count - done < INT_MAX ? (unsigned)(count - done) : INT_MAX;
        if (i->z.avail_in == 0 && !refill(i)) return -1;
        i->z.next_out = (unsigned char *)to + done;
        i->z.avail_out = step;
        int state = inflate(&i->z, Z_NO_FLUSH);
        done += step - i->z.avail_out;
        if (state == Z_STREAM_END)
            go_on(i);
        else
            i->broken = state != Z_OK && state != Z_BUF_ERROR;
    }
    return i->broken ? -1 : done;
}
