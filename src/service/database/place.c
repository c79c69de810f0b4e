// SPDX-License-Identifier: Apache-2.0
#include "service/database/place.h"

#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/database/header.h"

/* Instruction in messages about a loss. */
#define WAY_OUT                                                                                                     \
    "nothing is stored until it is there again: move it back, or restart hexad to use what is there now; \"A lost " \
    "state directory\" in doc/operations.md has the steps"

enum { PARTS = 4 };
static const char *const names[PARTS] = {"", "/" DATABASE_FILE_NAME, "/" DATABASE_FILE_NAME "-wal", "/lock"};

struct place {
    int directory_fd; /* keeps the inode of the directory in use; other code keeps those of the files */
    struct {
        char *path;
        dev_t device;
        ino_t inode;
    } part[PARTS];
    atomic_bool lost; /* the last comparison found a loss */
};

void place_free(place *p)
{
    if (!p) return;
    if (p->directory_fd >= 0) close(p->directory_fd);
    for (int i = 0; i < PARTS; i++) free(p->part[i].path);
    free(p);
}

place *place_note(const char *state_dir, error *e)
{
    place *p = mem_alloc(sizeof *p);
    p->directory_fd = open(state_dir, O_PATH | O_DIRECTORY | O_CLOEXEC);
    bool ok = p->directory_fd >= 0 || error_set(e, ERROR_INTERNAL, "%s: %s", state_dir, strerror(errno));
    for (int i = 0; ok && i < PARTS; i++) {
        struct stat info;
        p->part[i].path = mem_printf("%s%s", state_dir, names[i]);
        ok = stat(p->part[i].path, &info) == 0 ||
             error_set(e, ERROR_INTERNAL, "%s: %s", p->part[i].path, strerror(errno));
        if (!ok) break;
        p->part[i].device = info.st_dev;
        p->part[i].inode = info.st_ino;
    }
    if (ok) return p;
    place_free(p);
    return NULL;
}

/* Sets the error for a part whose stat failed with `fault`; 0: something else is at its path. */
static bool set_lost(const place *p, int part, int fault, error *e)
{
    static const char replaced[] = "was replaced by another one, or a file system was mounted over it",
                      gone[] = "was removed or renamed";
    const bool absent = fault == ENOENT || fault == ENOTDIR;
    return error_set(e, ERROR_STATE_LOST, "%s %.300s %s%s: %s",
                     part ? "the file of the state directory" : "the state directory", p->part[part].path,
                     !fault   ? replaced
                     : absent ? gone
                              : "cannot be examined: ",
                     !fault || absent ? "" : strerror(fault), WAY_OUT);
}

static bool compare(const place *p, error *e)
{
    for (int i = 0; i < PARTS; i++) {
        struct stat info;
        if (stat(p->part[i].path, &info) != 0) return set_lost(p, i, errno, e);
        if (info.st_dev != p->part[i].device || info.st_ino != p->part[i].inode) return set_lost(p, i, 0, e);
    }
    return true;
}

bool place_check(place *p, error *e)
{
    error why = {0};
    if (!p) return true;
    const bool lost = !compare(p, &why), was_lost = atomic_exchange(&p->lost, lost);
    if (lost && !was_lost) log_write(LOG_LEVEL_ERROR, "%s", why.message);
    if (!lost && was_lost)
        log_write(LOG_LEVEL_INFO, "the state directory is at its path again, and changes are stored again");
    if (lost && e) *e = why;
    return !lost;
}
