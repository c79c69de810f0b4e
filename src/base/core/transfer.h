// SPDX-License-Identifier: Apache-2.0
/* transfer: reads and writes whole blocks. Repeats calls that a signal interrupts or that transfer only a
 * part. On failure errno is set, except after a write of 0 bytes. Any thread.
 */
#ifndef HEXAD_BASE_CORE_TRANSFER_H
#define HEXAD_BASE_CORE_TRANSFER_H

#include <errno.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <unistd.h>

/* Returns the number of bytes read, which is less than `count` only at the end of the file; -1 on failure. */
static inline int64_t transfer_read_at(int fd, void *to, size_t count, uint64_t at)
{
    size_t done = 0;
    while (done < count) {
        const ssize_t got = pread(fd, (char *)to + done, count - done, (off_t)(at + done));
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) return -1;
        if (got == 0) break;
        done += (size_t)got;
    }
    return (int64_t)done;
}

/* A call that writes nothing is a failure. */
static inline bool transfer_write_at(int fd, const void *from, size_t count, uint64_t at)
{
    for (size_t done = 0; done < count;) {
        const ssize_t wrote = pwrite(fd, (const char *)from + done, count - done, (off_t)(at + done));
        if (wrote < 0 && errno == EINTR) continue;
        if (wrote <= 0) return false;
        done += (size_t)wrote;
    }
    return true;
}

static inline bool transfer_write(int fd, const void *from, size_t count)
{
    for (const char *next = from; count > 0;) {
        const ssize_t wrote = write(fd, next, count);
        if (wrote < 0 && errno == EINTR) continue;
        if (wrote <= 0) return false;
        next += wrote;
        count -= (size_t)wrote;
    }
    return true;
}

#endif
