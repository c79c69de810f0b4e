#include "executor/storage.h"

#include <inttypes.h>
#include <stdio.h>
#include <sys/statvfs.h>

#include "base/log.h"

static const char *const parts[] = {"", "/attempts", "/results",
                                    "/inputs"}; /* the first, of state_dir, too */

int64_t storage_free_bytes(const storage *s, int64_t *size_bytes, const char **directory)
{
    int64_t least = INT64_MAX;
    *size_bytes = 0;
    *directory = s->state_dir;
    size_t count = sizeof parts / sizeof *parts;
    for (size_t i = 0; i <= count; i++) {
        char path[4096];
        struct statvfs disk;
        int length = i < count ? snprintf(path, sizeof path, "%s%s", s->work_dir, parts[i])
                               : snprintf(path, sizeof path, "%s", s->state_dir);
        if (length >= (int)sizeof path || statvfs(path, &disk) != 0 || !disk.f_blocks) continue;
        int64_t bytes = (int64_t)(disk.f_bavail * disk.f_frsize);
        if (bytes >= least) continue;
        least = bytes;
        *size_bytes = (int64_t)(disk.f_blocks * disk.f_frsize);
        *directory = i < count ? s->work_dir : s->state_dir;
    }
    return least;
}

bool storage_has_space(storage *s)
{
    if (s->floor_bytes <= 0) return true;
    const char *directory;
    int64_t size, bytes = storage_free_bytes(s, &size, &directory);
    bool low = bytes < s->floor_bytes;
    if (low && !s->low)
        log_write(LOG_LEVEL_WARNING,
                  "the disk is full: no job starts until space is free: directory=%s free_mb=%" PRId64
                  " free_space_mb=%" PRId64,
                  directory, bytes >> 20, s->floor_bytes >> 20);
    if (!low && s->low) log_write(LOG_LEVEL_INFO, "the disk has space again: free_mb=%" PRId64, bytes >> 20);
    s->low = low;
    return !low;
}
