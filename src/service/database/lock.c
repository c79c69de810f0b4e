// SPDX-License-Identifier: Apache-2.0
#include "service/database/lock.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/denial.h"
#include "base/core/log.h"
#include "base/core/memory.h"

/* Maximum time, and interval, of attempts to take a lock that another process holds. */
#define PATIENCE_MS 1000
#define POLL_MS 20

static void describe_holder(int fd, const char *state_dir, error *e)
{
    char holder[16] = "";
    ssize_t got = pread(fd, holder, sizeof holder - 1, 0);
    holder[got > 0 ? got : 0] = '\0';
    error_set(e, ERROR_INTERNAL,
              "another hexad (process %s) uses the state directory %s: stop it, or choose another "
              "state_dir",
              holder, state_dir);
}

/* A lock file that root creates gets the owner of the state directory, so that the daemon can still use
 * it. */
static bool give_to_owner(int fd, const char *state_dir)
{
    struct stat owner;
    return geteuid() != 0 || (stat(state_dir, &owner) == 0 && fchown(fd, owner.st_uid, owner.st_gid) == 0);
}

/* Overwrites in place, because a full disk must not prevent the start. */
static void note_holder(int fd)
{
    char holder[16];
    int length = snprintf(holder, sizeof holder, "%d", (int)getpid());
    bool ok = pwrite(fd, holder, (size_t)length, 0) == length;
    if (ftruncate(fd, ok ? length : 0) != 0 || !ok)
        log_write(LOG_LEVEL_WARNING, "cannot write the process number into the file lock: %s",
                  strerror(errno));
}

/* A killed process holds its lock until the kernel has released it. */
static bool lock_file(int fd, int64_t patience_ms)
{
    int64_t until_ms = clock_monotonic_ms() + patience_ms;
    while (flock(fd, LOCK_EX | LOCK_NB) != 0) {
        if (errno != EWOULDBLOCK || clock_monotonic_ms() >= until_ms) return false;
        poll(NULL, 0, POLL_MS);
    }
    return true;
}

static void fail_to_lock(const char *path, error *e)
{
    const int fault = errno;
    char *why = denial_explain(path, fault, DENIAL_OWN, "");
    error_set(e, ERROR_INTERNAL, "cannot lock %s: %s%s", path, strerror(fault), why);
    free(why);
}

int lock_take(const char *state_dir, bool *in_use, error *e)
{
    char *path = mem_printf("%s/lock", state_dir);
    int fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    bool ok = fd >= 0 && give_to_owner(fd, state_dir) && lock_file(fd, in_use ? 0 : PATIENCE_MS);
    bool held = !ok && fd >= 0 && errno == EWOULDBLOCK;
    if (held)
        describe_holder(fd, state_dir, e);
    else if (!ok)
        fail_to_lock(path, e);
    else
        note_holder(fd);
    if (in_use) *in_use = held;
    if (!ok && fd >= 0) close(fd);
    free(path);
    return ok ? fd : -1;
}
