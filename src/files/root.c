// SPDX-License-Identifier: Apache-2.0
#include "files/root.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
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

#include "base/core/denial.h"
#include "base/core/frames.h"
#include "base/core/memory.h"
#include "files/sent_file.h"

/* O_NONBLOCK: opening a FIFO must not wait for a writer; it has no effect on regular files. */
#define OPEN_FLAGS (O_RDONLY | O_CLOEXEC | O_NOCTTY | O_NONBLOCK)

/* Limit of links on the way to a file; equal to the kernel's limit. */
#define MOST_LINKS 40

/* openat2 fails with EAGAIN if a rename happens during its walk. OPEN_TRIES failures indicate an attack. */
#define OPEN_TRIES 64

typedef struct root {
    int directory;
    char *only;     /* the only file in it that may be read; NULL: all files */
    bool sent;      /* the directory of uploaded files */
    char *given;    /* as configured, without trailing slashes */
    char *resolved; /* without symbolic links */
} root;

struct store_roots {
    atomic_bool changed; /* the setting input_roots has changed */
    size_t count;
    root item[];
};

static char *without_trailing_slashes(const char *path)
{
    size_t length = strlen(path);
    while (length > 1 && path[length - 1] == '/') length--;
    return mem_strndup(path, length);
}

/* Opens the directory, or the parent of a single file. */
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

/* The instruction in the message about a root that cannot be opened. */
static const char *advice_on_root(const char *path)
{
    if (*path != '/') return "; write an absolute path";
    return strchr(path, ' ') ? "; separate paths by a colon or a comma" : "; mount it, or correct the path";
}

static bool root_open(const char *path, root *r, error *e)
{
    char *resolved = realpath(path, NULL), *only = NULL;
    int directory = resolved ? open_directory(resolved, &only) : -1;
    if (directory < 0) {
        const int fault = errno;
        char *why = denial_explain(path, fault, DENIAL_READ, advice_on_root(path));
        error_set(e, ERROR_INPUT_MISSING, "input_roots: cannot open the input root %s: %s%s", path,
                  strerror(fault), why);
        free(why);
        free(resolved);
        return false;
    }
    *r = (root){directory, only, false, without_trailing_slashes(path), resolved};
    return true;
}

store_roots *store_roots_open(const char *sent, const char *const *paths, size_t count, error *e)
{
    store_roots *roots = mem_alloc(sizeof *roots + (count + 1) * sizeof roots->item[0]);
    bool ok = !sent || root_open(sent, &roots->item[0], e);
    if (sent && ok) roots->item[roots->count++].sent = true;
    for (size_t i = 0; ok && i < count; i++) {
        ok = root_open(paths[i], &roots->item[roots->count], e);
        roots->count += ok;
    }
    if (ok) return roots;
    store_roots_close(roots);
    return NULL;
}

void store_roots_note_change(store_roots *roots, bool changed)
{
    atomic_store(&roots->changed, changed);
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

static int walk(int directory, const char *path, int flags)
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
                          *rest ? O_PATH | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC : flags | O_NOFOLLOW);
            /* openat with O_PATH and O_DIRECTORY fails with ENOTDIR for a symbolic link */
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

int store_open_walking(int directory, const char *path)
{
    return walk(directory, path, OPEN_FLAGS);
}

static int open_beneath(int directory, const char *path, int flags)
{
#ifdef HAVE_LINUX_OPENAT2_H
    struct open_how how = {.flags = (uint64_t)flags, .resolve = RESOLVE_BENEATH | RESOLVE_NO_MAGICLINKS};
    for (int i = 0; i < OPEN_TRIES; i++) {
        long fd = syscall(SYS_openat2, directory, path, &how, sizeof how);
        if (fd >= 0) return (int)fd;
        if (errno == ENOSYS || errno == EPERM) return walk(directory, path, flags);
        if (errno != EAGAIN && errno != EINTR) return -1;
    }
    errno = EXDEV;
    return -1;
#else
    return walk(directory, path, flags);
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

/* The part of `path` after `prefix`, or NULL if the path does not lie below the prefix. */
static const char *below(const char *path, const char *prefix)
{
    size_t length = strlen(prefix);
    if (length == 1) length = 0; /* the root "/" */
    if (strncmp(path, prefix, length) != 0 || path[length] != '/') return NULL;
    return path + length + strspn(path + length, "/");
}

/* The part of the path below the root, or NULL if the path does not lie below it. */
static const char *inside(const root *r, const char *path, bool sent)
{
    if (r->only) {
        bool meant =
            strcmp(path, r->only) == 0 || strcmp(path, r->given) == 0 || strcmp(path, r->resolved) == 0;
        return meant ? r->only : NULL;
    }
    if (r->sent) return sent ? path : NULL;
    if (path[0] != '/') return path;
    const char *rest = below(path, r->given);
    return rest ? rest : below(path, r->resolved);
}

/* A path whose links are being resolved: the part without links, below a root, and the rest. */
typedef struct route {
    const root *in;
    char done[PATH_MAX], rest[PATH_MAX];
} route;

/* Inserts `first` before the rest. False and errno if the result is too long. */
static bool prepend(route *w, const char *first)
{
    char rest[PATH_MAX];
    strcpy(rest, w->rest);
    bool fits = (size_t)snprintf(w->rest, sizeof w->rest, "%s/%s", first, rest) < sizeof w->rest;
    if (!fits) errno = ENAMETOOLONG;
    return fits;
}

/* Removes the first component from the rest. False if the rest is empty. */
static bool next_part(route *w, char part[PATH_MAX])
{
    const char *start = w->rest + strspn(w->rest, "/");
    size_t length = strcspn(start, "/");
    memcpy(part, start, length);
    part[length] = '\0';
    memmove(w->rest, start + length, strlen(start + length) + 1);
    return length > 0;
}

/* Appends a component. False and errno if the result is too long. */
static bool append_part(char path[PATH_MAX], const char *part)
{
    size_t used = strlen(path), length = strlen(part);
    if (used + length + 2 > PATH_MAX) {
        errno = ENAMETOOLONG;
        return false;
    }
    path[used] = '/';
    memcpy(path + used + 1, part, length + 1);
    return true;
}

static bool drop_last(char *path)
{
    char *slash = strrchr(path, '/');
    if (slash) *slash = '\0';
    return slash != NULL;
}

/* The rest is an absolute path: finds the root that contains it and continues below that root. */
static bool enter_root(const store_roots *roots, route *w)
{
    char part[PATH_MAX];
    w->done[0] = '\0';
    for (;;) {
        for (size_t i = 0; i < roots->count; i++) {
            const root *r = &roots->item[i];
            bool here = strcmp(w->done, r->given) == 0 || strcmp(w->done, r->resolved) == 0 ||
                        (!*w->done && strcmp(r->resolved, "/") == 0);
            if (!here || r->sent || r->only) continue;
            w->in = r;
            w->done[0] = '\0';
            return true;
        }
        if (!next_part(w, part)) break;
        if (strcmp(part, "..") == 0)
            drop_last(w->done);
        else if (strcmp(part, ".") != 0 && !append_part(w->done, part))
            return false;
    }
    errno = EXDEV;
    return false;
}

/* Moves the next component of the rest to the resolved part. Resolves at most one link. */
static bool take_part(const store_roots *roots, route *w, const char *part, int *links)
{
    char target[PATH_MAX];
    size_t used = strlen(w->done);
    if (strcmp(part, ".") == 0) return true;
    if (strcmp(part, "..") == 0) {
        if (drop_last(w->done)) return true;
        char above[PATH_MAX]; /* the parent of the root */
        snprintf(above, sizeof above, "%s", w->in->resolved);
        drop_last(above);
        return prepend(w, above) && enter_root(roots, w);
    }
    if (!append_part(w->done, part)) return false;
    ssize_t length = readlinkat(w->in->directory, w->done + 1, target, sizeof target - 1);
    if (length < 0) return errno == EINVAL; /* EINVAL: not a link */
    w->done[used] = '\0';
    target[length] = '\0';
    if (++*links > MOST_LINKS) {
        errno = ELOOP;
        return false;
    }
    return prepend(w, target) && (*target != '/' || enter_root(roots, w));
}

/* Opens a path with links that may lead to other roots. */
static int open_linked(const store_roots *roots, const root *in, const char *path, int flags)
{
    char part[PATH_MAX];
    route w = {.in = in};
    int links = 0;
    if (!prepend(&w, path)) return -1;
    while (next_part(&w, part))
        if (!take_part(roots, &w, part, &links)) return -1;
    return walk(w.in->directory, *w.done ? w.done + 1 : ".", flags);
}

static int open_below(const store_roots *roots, const root *r, const char *path, int flags)
{
    int fd = open_beneath(r->directory, path, flags);
    return fd < 0 && errno == EXDEV && !r->only && !r->sent ? open_linked(roots, r, path, flags) : fd;
}

/* The path of a frame has a number in place of the pattern, so a path that still has the pattern names no
 * frame. A relative path is often a path on the client's machine. `sent`: the path is the name of an
 * uploaded file. */
static void set_missing(const char *path, const char *where, bool sent, int why, error *e)
{
    const bool denied = why == EACCES;
    const char *hint = frames_is_pattern(path) ? "add queue.frames: " FRAMES_NOTATIONS
                                                 " in a path stands for the frame number"
                       : sent                   ? "upload it again with hexadctl upload"
                       : denied && *where       ? "let the user of the service read it"
                       : denied                 ? "let this user read it"
                       : *where && *path != '/' ? "upload the file with hexadctl upload, or correct the path"
                                                : "put the file there, or correct the path";
    error_set(e, ERROR_INPUT_MISSING, "cannot read %s%s: %s; %s", path, where, strerror(why), hint);
}

/* Whether the path below a root names the root itself: it is empty, or has no other step than ".". */
static bool is_here(const char *rest)
{
    bool here = true;
    while (here && *rest) {
        here = rest[0] == '.' && (rest[1] == '/' || !rest[1]);
        rest += 1 + strspn(rest + 1, "/");
    }
    return here;
}

static bool set_is_root(const char *path, error_code code, error *e)
{
    return error_set(e, code, "%s is an input root: name a file below it", path);
}

/* Sets the error for a path that lies below no root. */
static void set_outside(const store_roots *roots, const char *path, error *e)
{
    for (size_t i = 0; i < roots->count; i++) {
        const root *r = &roots->item[i];
        if (r->sent || r->only || (strcmp(path, r->given) != 0 && strcmp(path, r->resolved) != 0)) continue;
        set_is_root(path, ERROR_PATH_FORBIDDEN, e);
        return;
    }
    bool is_directory;
    const bool none = !store_roots_name(roots, 0, &is_directory);
    const char *upload = frames_is_pattern(path)
                             ? ""
                             : "send the file with hexadctl upload (not the frames of a sequence), ",
               *move = none ? "" : "move it below one of them, ";
    error_set(e, ERROR_PATH_FORBIDDEN, "%s %s: %s%s%s%s", path,
              none ? "cannot be read, because this service has no input roots" : "is outside the input roots",
              upload, move, *upload || *move ? "or " : "",
              atomic_load(&roots->changed)
                  ? "restart hexad, which applies the changed setting input_roots"
                  : "add its directory to the setting input_roots and restart hexad");
}

static int open_in_roots(const store_roots *roots, const char *path, int flags, error *e)
{
    char name[STORE_INPUT_NAME_SIZE];
    bool sent = sent_file_match(path, name);
    bool found_root = sent; /* a removed upload lies below no root */
    int why = ENOENT;
    if (has_parent_step(path)) {
        error_set(e, ERROR_PATH_FORBIDDEN, "%s: the path must not contain \"..\"", path);
        return -1;
    }
    for (size_t i = 0; i < roots->count; i++) {
        const char *rest = inside(&roots->item[i], sent ? name : path, sent);
        if (!rest) continue;
        found_root = true;
        int fd = open_below(roots, &roots->item[i], *rest ? rest : ".", flags);
        if (fd >= 0) return fd;
        why = errno;
        if (why != ENOENT && why != ENOTDIR) break;
    }
    if (!found_root)
        set_outside(roots, path, e);
    else if (why == EXDEV || why == ELOOP)
        error_set(e, ERROR_PATH_FORBIDDEN,
                  "%s is a symbolic link to a place outside the input roots: copy the file, or add "
                  "that place to the setting input_roots",
                  path);
    else
        set_missing(path, sent ? "" : " below the input roots", sent, why, e);
    return -1;
}

static int open_place(const store_roots *roots, const char *path, int flags, error *e)
{
    if (roots) return open_in_roots(roots, path, flags, e);
    const int fd = open(path, flags);
    if (fd < 0) set_missing(path, "", false, errno, e);
    return fd;
}

/* Whether a directory is a root. */
static bool names_root(const store_roots *roots, const char *path)
{
    bool found = false;
    for (size_t i = 0; roots && i < roots->count; i++) {
        const char *rest = inside(&roots->item[i], path, false);
        found |= rest && !roots->item[i].only && is_here(rest);
    }
    return found;
}

int store_open_place(const store_roots *roots, const char *path, bool *is_directory, error *e)
{
    struct stat info;
    *is_directory = false;
    if (!*path) {
        error_set(e, ERROR_INPUT_MISSING, "the path is empty: give the path of a file");
        return -1;
    }
    error failed = {0};
    const int fd = open_place(roots, path, OPEN_FLAGS, &failed);
    if (fd >= 0 && fstat(fd, &info) == 0 && S_ISREG(info.st_mode)) return fd;
    if (fd >= 0) {
        close(fd);
        error_set(&failed, ERROR_INPUT_UNSUPPORTED, "%s is not a regular file: give the path of a file",
                  path);
    }
    /* a sandbox may permit to pass through a directory and not to read it */
    const int directory = open_place(roots, path, O_PATH | O_DIRECTORY | O_CLOEXEC, NULL);
    *is_directory = directory >= 0 && !names_root(roots, path);
    if (directory < 0 && e) *e = failed;
    if (directory < 0 || *is_directory) return directory;
    close(directory);
    set_is_root(path, ERROR_INPUT_UNSUPPORTED, e);
    return -1;
}

int store_open_input(const store_roots *roots, const char *path, error *e)
{
    bool is_directory = false;
    const int fd = store_open_place(roots, path, &is_directory, e);
    if (fd < 0 || !is_directory) return fd;
    close(fd);
    error_set(
        e, ERROR_INPUT_UNSUPPORTED,
        "%s is a directory: give the path of a file, or name an OME-Zarr directory as /surface/volume/path or "
        "/surface/labels/path (`dcm2niix` converts a folder of DICOM files to NIfTI)",
        path);
    return -1;
}

int store_open_directory(const store_roots *roots, const char *path, error *e)
{
    struct stat info;
    size_t length = strlen(path);
    while (length && path[length - 1] == '/') length--;
    char *inside_it = mem_printf("%.*s/", (int)length, path); /* with a slash a root lies below itself */
    int fd = open_in_roots(roots, inside_it, OPEN_FLAGS, e);
    free(inside_it);
    if (fd < 0 || (fstat(fd, &info) == 0 && S_ISDIR(info.st_mode))) return fd;
    close(fd);
    error_set(e, ERROR_INPUT_MISSING, "%s is not a directory: give the path of a directory", path);
    return -1;
}

bool store_find_input(const store_roots *roots, const char *path, struct stat *info)
{
    int fd = open_in_roots(roots, path, OPEN_FLAGS, NULL);
    if (fd < 0) return false;
    bool found = fstat(fd, info) == 0 && (S_ISREG(info->st_mode) || S_ISDIR(info->st_mode));
    close(fd);
    return found;
}

const char *store_roots_name(const store_roots *roots, size_t index, bool *directory)
{
    size_t first = roots->count && roots->item[0].sent;
    if (first + index >= roots->count) return NULL;
    *directory = !roots->item[first + index].only;
    return roots->item[first + index].given;
}
