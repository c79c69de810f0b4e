#include "store/output.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/memory.h"

#define DIRECTORY (O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC)

static const char *below(const char *path, const char *root)
{
    size_t length = strlen(root);
    while (length > 0 && root[length - 1] == '/') length--;
    return strncmp(path, root, length) == 0 && path[length] == '/' ? path + length : NULL;
}

/* The next part of a path, and moves on; false at the end, or *ok false when it is no name. */
static bool next_part(const char **at, char name[NAME_MAX + 1], bool *ok)
{
    *at += strspn(*at, "/");
    size_t length = strcspn(*at, "/");
    *ok = length <= NAME_MAX && strncmp(*at, "..", length > 2 ? length : 2) != 0;
    if (!length) *ok = true;
    if (!length || !*ok) return false;
    memcpy(name, *at, length);
    name[length] = '\0';
    *at += length;
    return true;
}

bool store_output_check(const store_outputs *outputs, const char *path, error *e)
{
    char name[NAME_MAX + 1];
    bool ok = true;
    for (const char *at = path; next_part(&at, name, &ok);) continue;
    if (!ok) return error_set(e, ERROR_PATH_FORBIDDEN, "%s: a part is \"..\" or too long", path);
    for (size_t i = 0; i < outputs->root_count; i++)
        if (below(path, outputs->roots[i])) return true;
    return error_set(e, ERROR_PATH_FORBIDDEN, "%s lies outside the output roots of this service%s", path,
                     *path == '/' ? "" : ": give an absolute path");
}

static bool fail(error *e, const char *what, const char *path)
{
    return error_set(e,
                     errno == ELOOP || errno == ENOTDIR ? ERROR_PATH_FORBIDDEN : error_code_of_errno(errno),
                     "%s: %s: %s", path, what, errno == ELOOP ? "a symbolic link" : strerror(errno));
}

/* What was made is given its mode and group, whatever the umask. */
static bool adopt(const store_outputs *outputs, int fd, mode_t mode)
{
    return (outputs->group == (gid_t)-1 || fchown(fd, (uid_t)-1, outputs->group) == 0) &&
           fchmod(fd, mode) == 0;
}

/* Opens the directory, making what is missing if so wanted; -1 on failure. */
static int open_directory(const store_outputs *outputs, const char *path, bool make, error *e)
{
    const char *rest = NULL;
    size_t i = 0;
    while (!rest) rest = below(path, outputs->roots[i++]);
    int here = open(outputs->roots[i - 1], O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    char name[NAME_MAX + 1];
    bool ok = true;
    while (here >= 0 && next_part(&rest, name, &ok)) {
        mode_t mode = outputs->mode | ((outputs->mode & 0444) >> 2);
        bool made = make && mkdirat(here, name, 0700) == 0;
        int next = made || !make || errno == EEXIST ? openat(here, name, DIRECTORY) : -1;
        if (next >= 0 && made && (!adopt(outputs, next, mode) || fsync(here) != 0)) {
            int why = errno;
            close(next);
            next = -1;
            errno = why;
        }
        int why = errno;
        close(here);
        errno = why;
        here = next;
    }
    if (here < 0) fail(e, make ? "cannot be made" : "cannot be opened", path);
    return here;
}

static bool copy_bytes(int from, int to)
{
    char block[1 << 16];
    for (ssize_t got; (got = read(from, block, sizeof block)) != 0;) {
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) return false;
        for (ssize_t done = 0, wrote; done < got; done += wrote) {
            wrote = write(to, block + done, (size_t)(got - done));
            if (wrote < 0 && errno != EINTR) return false;
            if (wrote < 0) wrote = 0;
        }
    }
    return true;
}

static bool copy_file(const store_outputs *outputs, int from, int to, const char *name, const char *temporary)
{
    int in = openat(from, name, O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
    if (in < 0) return false;
    unlinkat(to, temporary, 0); /* of a try before */
    int out = openat(to, temporary, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
    bool ok = out >= 0 && copy_bytes(in, out) && adopt(outputs, out, outputs->mode) && fsync(out) == 0;
    int why = errno;
    close(in);
    if (out >= 0 && close(out) != 0 && ok) {
        ok = false;
        why = errno;
    }
    if (ok) {
        ok = renameat(to, temporary, to, name) == 0;
        why = errno;
    }
    if (!ok && out >= 0) unlinkat(to, temporary, 0);
    errno = why;
    return ok;
}

bool store_output_copy(const store_outputs *outputs, const char *from, const char *const *names, size_t count,
                       const char *path, const char *temporary, error *e)
{
    if (!store_output_check(outputs, path, e)) return false;
    int to = open_directory(outputs, path, true, e);
    if (to < 0) return false;
    int source = open(from, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    bool ok =
        (source >= 0 || fail(e, "cannot be read", from)) &&
        (unlinkat(to, names[count - 1], 0) == 0 || errno == ENOENT || fail(e, "cannot be replaced", path)) &&
        (fsync(to) == 0 || fail(e, "cannot be flushed", path));
    for (size_t i = 0; ok && i < count; i++) {
        if (i + 1 == count) ok = fsync(to) == 0 || fail(e, "cannot be flushed", path);
        if (ok && !copy_file(outputs, source, to, names[i], temporary)) ok = fail(e, names[i], path);
    }
    ok = ok && (fsync(to) == 0 || fail(e, "cannot be flushed", path));
    if (source >= 0) close(source);
    close(to);
    return ok;
}

bool store_output_clear(const store_outputs *outputs, const char *path, const char *temporary, error *e)
{
    if (!store_output_check(outputs, path, e)) return false;
    int directory = open_directory(outputs, path, false, e);
    if (directory < 0) return false;
    bool ok =
        unlinkat(directory, temporary, 0) == 0 || errno == ENOENT || fail(e, "cannot be removed", temporary);
    close(directory);
    return ok;
}
