// SPDX-License-Identifier: Apache-2.0
#include "base/core/control_group.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/xattr.h>
#include <unistd.h>

#include "base/core/memory.h"

#define ROOT "/sys/fs/cgroup"
/* systemd (from version 251) sets this attribute of a group that it has delegated to an unprivileged
 * service. */
#define DELEGATED "user.delegate"
/* The subgroup of this process, and the prefix of the names of other subgroups. */
#define OWN_GROUP "service"
#define PREFIX "attempt."

struct control_groups {
    int directory;
    atomic_uint_fast64_t number; /* number of the next group */
};

struct control_group {
    const control_groups *groups;
    char name[40];
    int directory;
    int entry; /* cgroup.procs */
};

/* Reads a file of at most `size` - 1 bytes. False: it cannot be read. */
static bool read_file(int directory, const char *name, char *text, size_t size)
{
    int fd = openat(directory, name, O_RDONLY | O_CLOEXEC);
    ssize_t got = fd < 0 ? -1 : read(fd, text, size - 1);
    if (fd >= 0) close(fd);
    text[got > 0 ? got : 0] = '\0';
    return got >= 0;
}

static bool write_file(int directory, const char *name, const char *text, error *e)
{
    int fd = openat(directory, name, O_WRONLY | O_CLOEXEC);
    bool ok = fd >= 0 && write(fd, text, strlen(text)) == (ssize_t)strlen(text);
    if (!ok) error_set(e, ERROR_INTERNAL, "control group: %s in %s: %s", text, name, strerror(errno));
    if (fd >= 0) close(fd);
    return ok;
}

/* The number in a line `KEY NUMBER`, or in a file with a number only (key ""); 0: there is none. */
static int64_t read_number(int directory, const char *name, const char *key)
{
    char text[512];
    size_t length = strlen(key);
    if (!read_file(directory, name, text, sizeof text)) return 0;
    for (const char *line = text; line; line = strchr(line, '\n') ? strchr(line, '\n') + 1 : NULL)
        if (strncmp(line, key, length) == 0 && (!length || line[length] == ' '))
            return strtoll(line + length, NULL, 10);
    return 0;
}

static bool has_word(const char *list, const char *word)
{
    size_t length = strlen(word);
    for (const char *at = list; (at = strstr(at, word)); at += length)
        if ((at == list || at[-1] == ' ') && strchr(" \n", at[length])) return true;
    return false;
}

/* Removes groups of earlier runs. Groups in use are not empty and are not removed. No group is created at
 * this time. */
static void sweep(const control_groups *groups)
{
    int fd = openat(groups->directory, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    DIR *list = fd < 0 ? NULL : fdopendir(fd);
    if (!list && fd >= 0) close(fd);
    for (struct dirent *d; list && (d = readdir(list));)
        if (strncmp(d->d_name, PREFIX, strlen(PREFIX)) == 0)
            unlinkat(groups->directory, d->d_name, AT_REMOVEDIR);
    if (list) closedir(list);
}

bool control_groups_open_at(const char *directory, control_groups **groups, error *e)
{
    char controllers[512];
    *groups = NULL;
    control_groups made = {.directory = open(directory, O_RDONLY | O_DIRECTORY | O_CLOEXEC)};
    if (made.directory < 0) return true;
    if (!read_file(made.directory, "cgroup.controllers", controllers, sizeof controllers) ||
        !has_word(controllers, "memory")) {
        close(made.directory);
        return true;
    }
    sweep(&made);
    bool ok = mkdirat(made.directory, OWN_GROUP, 0755) == 0 || errno == EEXIST ||
              error_set(e, ERROR_INTERNAL, "%s/" OWN_GROUP ": %s", directory, strerror(errno));
    ok = ok && write_file(made.directory, OWN_GROUP "/cgroup.procs", "0", e) &&
         write_file(made.directory, "cgroup.subtree_control", "+memory", e);
    if (!ok) {
        close(made.directory);
        return false;
    }
    *groups = mem_alloc(sizeof **groups);
    (*groups)->directory = made.directory;
    return true;
}

bool control_groups_open(control_groups **groups, error *e)
{
    char text[4096], *line, delegated[4];
    *groups = NULL;
    if (!read_file(AT_FDCWD, "/proc/self/cgroup", text, sizeof text)) return true;
    line = strncmp(text, "0::", 3) == 0 ? text : strstr(text, "\n0::"); /* version 2 */
    if (!line) return true;
    line = strchr(line, '/');
    if (!line) return true;
    line[strcspn(line, "\n")] = '\0';
    char *directory = mem_printf("%s%s", ROOT, line);
    bool mine = getxattr(directory, DELEGATED, delegated, sizeof delegated) == 1 && delegated[0] == '1';
    bool ok = !mine || control_groups_open_at(directory, groups, e);
    free(directory);
    return ok;
}

void control_groups_close(control_groups *groups)
{
    if (!groups) return;
    sweep(groups);
    close(groups->directory);
    free(groups);
}

static bool set_limits(const control_group *g, int64_t memory_bytes, error *e)
{
    char bytes[24];
    snprintf(bytes, sizeof bytes, "%" PRId64, memory_bytes);
    return write_file(g->directory, "memory.max", bytes, e) &&
           write_file(g->directory, "memory.oom.group", "1", e) &&
           /* the file is missing in a kernel without swap accounting */
           (faccessat(g->directory, "memory.swap.max", F_OK, 0) != 0 ||
            write_file(g->directory, "memory.swap.max", "0", e));
}

control_group *control_group_new(control_groups *groups, int64_t memory_bytes, error *e)
{
    control_group *g = mem_alloc(sizeof *g);
    g->groups = groups;
    g->directory = g->entry = -1;
    snprintf(g->name, sizeof g->name, PREFIX "%" PRIuFAST64, groups->number++);
    bool ok = mkdirat(groups->directory, g->name, 0755) == 0;
    if (ok) g->directory = openat(groups->directory, g->name, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (ok && g->directory < 0) ok = false;
    if (!ok) error_set(e, ERROR_INTERNAL, "control group %s: %s", g->name, strerror(errno));
    ok = ok && set_limits(g, memory_bytes, e);
    if (ok) g->entry = openat(g->directory, "cgroup.procs", O_WRONLY | O_CLOEXEC);
    if (ok && g->entry >= 0) return g;
    if (ok) error_set(e, ERROR_INTERNAL, "control group %s: %s", g->name, strerror(errno));
    control_group_end(g);
    return NULL;
}

bool control_group_join(const control_group *g)
{
    return write(g->entry, "0", 1) == 1;
}

control_group_use control_group_end(control_group *g)
{
    control_group_use use = {0};
    if (!g) return use;
    if (g->directory >= 0) {
        write_file(g->directory, "cgroup.kill", "1", NULL);
        use.peak_bytes = read_number(g->directory, "memory.peak", "");
        /* otherwise a parent group reached its limit */
        use.exceeded = read_number(g->directory, "memory.events", "oom_kill") > 0 &&
                       read_number(g->directory, "memory.events", "oom") > 0;
        close(g->directory);
    }
    if (g->entry >= 0) close(g->entry);
    /* this fails while a process is exiting; the next start then removes it */
    unlinkat(g->groups->directory, g->name, AT_REMOVEDIR);
    free(g);
    return use;
}
