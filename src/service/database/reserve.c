// SPDX-License-Identifier: Apache-2.0
#include "service/database/reserve.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/database/header.h"

/* The first bytes of a WAL: its magic number. A file of zeros is an empty log. */
enum { HEADER_BYTES = 32 };
/* Usual size of the log: it is checkpointed from a thousand pages of 4 KiB, and grows meanwhile. On a full
 * disk it cannot be checkpointed, because the database would grow, and continues to grow. */
enum { USUAL_BYTES = 5 << 20 };

typedef struct names {
    char *database, *log, *reserve, *fresh;
} names;

static names names_in(const char *state_dir)
{
    return (names){mem_printf("%s/" DATABASE_FILE_NAME, state_dir),
                   mem_printf("%s/" DATABASE_FILE_NAME "-wal", state_dir),
                   mem_printf("%s/reserve", state_dir), mem_printf("%s/reserve.new", state_dir)};
}

static void names_free(names *n)
{
    free(n->database);
    free(n->log);
    free(n->reserve);
    free(n->fresh);
}

static bool is_same(const struct stat *a, const struct stat *b)
{
    return a->st_dev == b->st_dev && a->st_ino == b->st_ino;
}

/* The content belongs to a database that was closed. It must never be read as a log of another one. */
static bool empty_log(const char *path)
{
    static const char zeros[HEADER_BYTES];
    int fd = open(path, O_WRONLY | O_NOFOLLOW | O_CLOEXEC);
    if (fd < 0) return false;
    bool ok = pwrite(fd, zeros, sizeof zeros, 0) == sizeof zeros && fsync(fd) == 0;
    close(fd);
    return ok;
}

void reserve_lend(const char *state_dir)
{
    names n = names_in(state_dir);
    struct stat database, log, reserve;
    bool wanted = lstat(n.reserve, &reserve) == 0 && S_ISREG(reserve.st_mode) && reserve.st_nlink == 1 &&
                  lstat(n.log, &log) != 0 && errno == ENOENT && stat(n.database, &database) == 0 &&
                  database.st_size > 0;
    if (wanted && (!empty_log(n.reserve) || link(n.reserve, n.log) != 0))
        log_write(LOG_LEVEL_WARNING, "cannot use the reserved disk space (reserve_mb): %s: %s", n.reserve,
                  strerror(errno));
    names_free(&n);
}

/* Creates the second hard link to the log. */
static bool name_log(const names *n)
{
    struct stat log, reserve;
    unlink(n->fresh); /* left by a killed process */
    if (lstat(n->log, &log) != 0) return false;
    if (lstat(n->reserve, &reserve) == 0 && is_same(&log, &reserve)) return true;
    return link(n->log, n->fresh) == 0 && rename(n->fresh, n->reserve) == 0;
}

/* If the disk has too little space, fallocate would fail and still allocate the free blocks. */
static bool allocate(int fd, int64_t bytes)
{
    struct stat file;
    struct statvfs disk;
    if (fstat(fd, &file) != 0 || fstatvfs(fd, &disk) != 0) return false;
    int64_t there = (int64_t)file.st_blocks * 512;
    if (there >= bytes) return true;
    if ((int64_t)(disk.f_bavail * disk.f_frsize) >= bytes - there)
        return fallocate(fd, FALLOC_FL_KEEP_SIZE, 0, (off_t)bytes) == 0;
    errno = ENOSPC;
    return false;
}

bool reserve_keep(const char *state_dir, int64_t bytes)
{
    names n = names_in(state_dir);
    bool ok = true;
    if (bytes <= 0) {
        unlink(n.reserve);
    } else {
        int fd = open(n.log, O_WRONLY | O_NOFOLLOW | O_CLOEXEC);
        ok = fd >= 0 && name_log(&n) && allocate(fd, USUAL_BYTES + bytes);
        if (!ok)
            log_write(LOG_LEVEL_WARNING,
                      "cannot reserve disk space for the queue (reserve_mb): %s: %s; on a full disk, "
                      "cancelling and deleting jobs may fail",
                      n.log, strerror(errno));
        if (fd >= 0) close(fd);
    }
    names_free(&n);
    return ok;
}
