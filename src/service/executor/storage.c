// SPDX-License-Identifier: Apache-2.0
#include "service/executor/storage.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/denial.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/results/inventory.h"

/* Shortest interval between two probes, in ms: thousands of attempts may start in a second, and work_dir may
 * be on a network file system. */
#define PROBE_MS 1000

static const char *const names[STORAGE_PARTS] = {"attempts", "results", "inputs"};

int64_t storage_free_bytes(const storage *s, int64_t *size_bytes, const char **directory)
{
    static const char *const parts[] = {"", "/attempts", "/results",
                                        "/inputs"}; /* the first, of state_dir, too */
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

static void check_space(storage *s)
{
    if (s->floor_bytes <= 0) return;
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
}

/* Writes a file of one byte and removes it. Returns 0 or errno. */
static int probe(const char *path, bool flush)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0600);
    if (fd < 0) return errno;
    int why = write(fd, "", 1) == 1 && (!flush || fsync(fd) == 0) ? 0 : errno;
    if (close(fd) != 0 && !why) why = errno;
    if (unlink(path) != 0 && !why) why = errno;
    return why;
}

/* Whether no attempt starts because of the errno of a write. Without a floor, attempts start even on a
 * full disk. */
static bool holds_attempts(const storage *s, int part)
{
    int why = atomic_load(&s->fault[part]);
    return why && part != STORAGE_INPUTS &&
           (s->floor_bytes > 0 || error_code_of_errno(why) != ERROR_STORAGE_FULL);
}

/* The end of a message about a part that cannot be written, with the remedy. The caller frees it. */
static char *explain(const storage *s, int part, int fault)
{
    char *directory = mem_printf("%s/%s", s->work_dir, names[part]),
         *text = denial_explain(directory, fault, DENIAL_OWN, ": repair this directory or its disk");
    free(directory);
    return text;
}

static void probe_part(storage *s, int part, bool flush)
{
    char path[4096];
    int before = atomic_load(&s->fault[part]);
    bool fits = snprintf(path, sizeof path, "%s/%s/" INVENTORY_PROBE_NAME, s->work_dir, names[part]) <
                (int)sizeof path;
    int why = fits ? probe(path, flush || before) : ENAMETOOLONG;
    atomic_store(&s->fault[part], why);
    if (why && why != before) {
        char *reason = explain(s, part, why);
        log_write(LOG_LEVEL_ERROR, "cannot write to %s/%s: %s%s%s", s->work_dir, names[part], strerror(why),
                  reason, holds_attempts(s, part) ? ". No job starts until this is repaired" : "");
        free(reason);
    }
    if (!why && before)
        log_write(LOG_LEVEL_INFO, "files can be written again to %s/%s", s->work_dir, names[part]);
}

void storage_check(storage *s)
{
    int64_t now = clock_monotonic_ms();
    check_space(s);
    if (s->low) return;
    bool suspect = atomic_exchange(&s->suspect, false);
    if (!suspect && s->probed_ms && now < s->probed_ms + PROBE_MS) return;
    s->probed_ms = now;
    for (int part = 0; part < STORAGE_PARTS; part++) probe_part(s, part, suspect);
}

bool storage_may_start(storage *s)
{
    storage_check(s);
    return !s->low && !holds_attempts(s, STORAGE_ATTEMPTS) && !holds_attempts(s, STORAGE_RESULTS);
}

void storage_suspect(storage *s)
{
    atomic_store(&s->suspect, true);
}

bool storage_can_write(const storage *s, error *e)
{
    for (int part = 0; part < STORAGE_PARTS; part++) {
        int why = atomic_load(&s->fault[part]);
        if (!why) continue;
        char *reason = explain(s, part, why);
        error_set(e, error_code_of_errno(why), "cannot write to %.500s/%s: %s%s", s->work_dir, names[part],
                  strerror(why), reason);
        free(reason);
        return false;
    }
    return true;
}
