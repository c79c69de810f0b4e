#include "store/root.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#ifdef HAVE_CONFIG_H
#include "config.h"
#endif
#ifdef HAVE_LINUX_OPENAT2_H
#include <linux/openat2.h>
#endif

#include "base/memory.h"
#include "store/inputs.h"

/* O_NONBLOCK: opening a FIFO must not wait for a writer; it has no effect on regular files. */
#define OPEN_FLAGS (O_RDONLY | O_CLOEXEC | O_NOCTTY | O_NONBLOCK)

/* openat2 answers EAGAIN when a rename happens while it walks; that many times is an attack. */
#define OPEN_TRIES 64

typedef struct root {
    int directory;
    char *only;     /* the one file in it that may be read; NULL: all */
    char *given;    /* as configured, without trailing slashes */
    char *resolved; /* without symbolic links */
} root;

struct store_roots {
    size_t count;
    root item[];
};

static char *without_trailing_slashes(const char *path)
{
    size_t length = strlen(path);
    while (length > 1 && path[length - 1] == '/') length--;
    return mem_strndup(path, length);
}

/* The directory itself, or that of a single file. */
static int open_directory(const char *resolved, char **only)
{
    struct stat info;
    if (stat(resolved, &info) != 0 || !S_ISREG(info.st_mode))
        return open(resolved, O_PATH | O_DIRECTORY | O_CLOEXEC);
    const char *name = strrchr(resolved, '/') + 1;
    char *parent = mem_strndup(resolved, (size_t)(name - resolved));
    int directory = open(parent, O_PATH | O_DIRECTORY | O_CLOEXEC), why = errno;
    free(parent);
    if (directory >= 0) *only = mem_strdup(name);
    errno = why;
    return directory;
}

static bool root_open(const char *path, root *r, error *e)
{
    char *resolved = realpath(path, NULL), *only = NULL;
    int directory = resolved ? open_directory(resolved, &only) : -1;
    if (directory < 0) {
        error_set(e, ERROR_INPUT_MISSING, "input root %s cannot be opened: %s", path, strerror(errno));
        free(resolved);
        return false;
    }
    *r = (root){directory, only, without_trailing_slashes(path), resolved};
    return true;
}

store_roots *store_roots_open(const char *const *paths, size_t count, error *e)
{
    store_roots *roots = mem_alloc(sizeof *roots + count * sizeof roots->item[0]);
    for (; roots->count < count; roots->count++) {
        if (!root_open(paths[roots->count], &roots->item[roots->count], e)) {
            store_roots_close(roots);
            return NULL;
        }
    }
    return roots;
}

void store_roots_close(store_roots *roots)
{
    if (!roots) return;
    for (size_t i = 0; i < roots->count; i++) {
        close(roots->item[i].directory);
        free(roots->item[i].only);
        free(roots->item[i].given);
        free(roots->item[i].resolved);
    }
    free(roots);
}

int store_open_walking(int directory, const char *path)
{
    int here = dup(directory);
    while (here >= 0) {
        size_t length = strcspn(path, "/");
        const char *rest = path + length;
        rest += strspn(rest, "/");
        char name[NAME_MAX + 1];
        int next = -1;
        if (length > NAME_MAX) {
            errno = ENAMETOOLONG;
        } else if (length == 2 && memcmp(path, "..", 2) == 0) {
            errno = EXDEV;
        } else {
            memcpy(name, path, length);
            name[length] = '\0';
            next = openat(here, length ? name : ".",
                          *rest ? O_PATH | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC : OPEN_FLAGS | O_NOFOLLOW);
            /* O_PATH with O_DIRECTORY says ENOTDIR of a symbolic link */
            struct stat info;
            if (next < 0 && (errno == ELOOP || errno == ENOTDIR)) {
                int why = errno;
                bool is_link = fstatat(here, name, &info, AT_SYMLINK_NOFOLLOW) == 0 && S_ISLNK(info.st_mode);
                errno = is_link ? EXDEV : why;
            }
        }
        int why = errno;
        close(here);
        errno = why;
        if (next < 0 || !*rest) return next;
        here = next;
        path = rest;
    }
    return -1;
}

static int open_beneath(int directory, const char *path)
{
#ifdef HAVE_LINUX_OPENAT2_H
    struct open_how how = {.flags = OPEN_FLAGS, .resolve = RESOLVE_BENEATH | RESOLVE_NO_MAGICLINKS};
    for (int i = 0; i < OPEN_TRIES; i++) {
        long fd = syscall(SYS_openat2, directory, path, &how, sizeof how);
        if (fd >= 0) return (int)fd;
        if (errno == ENOSYS || errno == EPERM) return store_open_walking(directory, path);
        if (errno != EAGAIN && errno != EINTR) return -1;
    }
    errno = EXDEV;
    return -1;
#else
    return store_open_walking(directory, path);
#endif
}

static bool has_parent_step(const char *path)
{
    for (const char *part = path; *part;) {
        size_t length = strcspn(part, "/");
        if (length == 2 && memcmp(part, "..", 2) == 0) return true;
        part += length;
        part += strspn(part, "/");
    }
    return false;
}

/* What follows `prefix` in `path`, or NULL when the path does not lie below it. */
static const char *below(const char *path, const char *prefix)
{
    size_t length = strlen(prefix);
    if (length == 1) length = 0; /* the root "/" */
    if (strncmp(path, prefix, length) != 0 || path[length] != '/') return NULL;
    return path + length + strspn(path + length, "/");
}

static const char *inside(const root *r, const char *path)
{
    if (r->only) {
        bool meant =
            strcmp(path, r->only) == 0 || strcmp(path, r->given) == 0 || strcmp(path, r->resolved) == 0;
        return meant ? r->only : NULL;
    }
    if (path[0] != '/') return path;
    const char *rest = below(path, r->given);
    return rest ? rest : below(path, r->resolved);
}

static int open_in_roots(const store_roots *roots, const char *path, error *e)
{
    char name[STORE_INPUT_NAME_SIZE];
    const char *asked = store_inputs_is_sent(path, name) ? name : path;
    bool found_root = asked == name; /* what was sent and is gone has no root any more */
    int why = ENOENT;
    if (has_parent_step(path)) {
        error_set(e, ERROR_PATH_FORBIDDEN, "%s: a path may not contain \"..\"", path);
        return -1;
    }
    for (size_t i = 0; i < roots->count; i++) {
        const char *rest = inside(&roots->item[i], asked);
        if (!rest) continue;
        found_root = true;
        int fd = open_beneath(roots->item[i].directory, *rest ? rest : ".");
        if (fd >= 0) return fd;
        why = errno;
        if (why != ENOENT && why != ENOTDIR) break;
    }
    if (!found_root)
        error_set(e, ERROR_PATH_FORBIDDEN,
                  "%s lies outside the input roots: move the file below one, or add its directory to them",
                  path);
    else if (why == EXDEV || why == ELOOP)
        error_set(e, ERROR_PATH_FORBIDDEN, "%s leads out of its input root by a symbolic link", path);
    else
        error_set(e, ERROR_INPUT_MISSING, "%s cannot be read below the input roots: %s", path, strerror(why));
    return -1;
}

int store_open_input(const store_roots *roots, const char *path, error *e)
{
    if (!*path) {
        error_set(e, ERROR_INPUT_MISSING, "the path is empty");
        return -1;
    }
    int fd;
    if (roots) {
        fd = open_in_roots(roots, path, e);
        if (fd < 0) return -1;
    } else {
        fd = open(path, OPEN_FLAGS);
        if (fd < 0) {
            error_set(e, ERROR_INPUT_MISSING, "%s cannot be read: %s", path, strerror(errno));
            return -1;
        }
    }
    struct stat info;
    if (fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) {
        close(fd);
        error_set(e, ERROR_INPUT_UNSUPPORTED, "%s is not a regular file", path);
        return -1;
    }
    return fd;
}
