// SPDX-License-Identifier: Apache-2.0
#include "service/database/header.h"

#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/denial.h"
#include "base/core/memory.h"
#include "service/database/health.h"
#include "service/database/schema.h"

/* https://www.sqlite.org/fileformat.html, 1.3 */
enum { MAGIC_BYTES = 16, PAGE_SIZE_AT = 16, PAGE_COUNT_AT = 28, USER_VERSION_AT = 60, HEADER_BYTES = 100 };
static const char magic[MAGIC_BYTES] = "SQLite format 3";

bool header_exists(const char *state_dir)
{
    struct stat info;
    char *path = mem_printf("%s/" DATABASE_FILE_NAME, state_dir);
    /* a file that cannot be examined may exist: the error follows when it is opened */
    bool there = stat(path, &info) == 0 ? info.st_size > 0 : errno != ENOENT;
    free(path);
    return there;
}

/* Whether there is a log with content: it starts with a magic number, whose last bit gives the byte order. */
static bool has_log(const char *path)
{
    uint8_t begin[4] = {0};
    char *log = mem_printf("%s-wal", path);
    int fd = open(log, O_RDONLY | O_CLOEXEC);
    bool found = fd >= 0 && pread(fd, begin, sizeof begin, 0) == sizeof begin && begin[0] == 0x37 &&
                 begin[1] == 0x7f && begin[2] == 0x06 && (begin[3] | 1) == 0x83;
    if (fd >= 0) close(fd);
    free(log);
    return found;
}

static bool damaged(error *e, const char *what)
{
    return error_set(e, ERROR_DATABASE_DAMAGED, "the database is damaged (%s): %s", what, HEALTH_WAY_OUT);
}

static bool check(const uint8_t header[HEADER_BYTES], int64_t bytes, error *e)
{
    int64_t size = header[PAGE_SIZE_AT] << 8 | header[PAGE_SIZE_AT + 1], count = 0;
    if (size == 1) size = 65536;
    for (int i = 0; i < 4; i++) count = count << 8 | header[PAGE_COUNT_AT + i];
    if (memcmp(header, magic, MAGIC_BYTES) != 0)
        return damaged(e, "the file does not have the header of a database");
    if (size < 512 || (size & (size - 1))) return damaged(e, "its header has no page size");
    if (bytes >= size * count && bytes % size == 0) {
        int32_t version = 0;
        for (int i = 0; i < 4; i++) version = version << 8 | header[USER_VERSION_AT + i];
        return schema_check_version(version, e);
    }
    char *what =
        mem_printf("the file has %lld bytes instead of %lld", (long long)bytes, (long long)(size * count));
    damaged(e, what);
    free(what);
    return false;
}

bool header_check(const char *path, error *e)
{
    struct stat info;
    uint8_t header[HEADER_BYTES];
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0 && errno == ENOENT) return true;
    if (fd < 0) {
        const int fault = errno;
        char *why = denial_explain(path, fault, DENIAL_OWN, "");
        error_set(e, ERROR_INTERNAL, "it cannot be opened: %s%s", strerror(fault), why);
        free(why);
        return false;
    }
    ssize_t got = fstat(fd, &info) == 0 ? pread(fd, header, sizeof header, 0) : -1;
    bool ok;
    if (got < 0)
        ok = error_set(e, ERROR_INTERNAL, "it cannot be read: %s", strerror(errno));
    else if (got == 0 || has_log(path))
        ok = true;
    else if (got < HEADER_BYTES)
        ok = damaged(e, "the file is shorter than the header of a database");
    else
        ok = check(header, info.st_size, e);
    close(fd);
    return ok;
}
