// SPDX-License-Identifier: Apache-2.0
#include "files/output.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <nettle/sha2.h>

#include "base/core/denial.h"
#include "base/core/memory.h"
#include "base/core/transfer.h"
#include "files/file.h"

#define DIRECTORY (O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC)

static const char *below(const char *path, const char *root)
{
    size_t length = strlen(root);
    while (length > 0 && root[length - 1] == '/') length--;
    return strncmp(path, root, length) == 0 && path[length] == '/' ? path + length : NULL;
}

/* Returns the next component of a path and advances. False at the end; *ok is false if the component is not a
 * valid name. */
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

/* Sets the error for a path that lies below no root. */
static bool set_outside(const store_outputs *outputs, const char *path, error *e)
{
    if (*path != '/')
        return error_set(e, ERROR_PATH_FORBIDDEN,
                         "%s is outside the output roots of this service: give an absolute path", path);
    if (!outputs->root_count)
        return error_set(e, ERROR_PATH_FORBIDDEN,
                         "%s: this service copies no results: add a directory to the setting output_roots",
                         path);
    char *slashed = mem_printf("%s/", path);
    bool is_root = false;
    for (size_t i = 0; !is_root && i < outputs->root_count; i++)
        is_root = below(slashed, outputs->roots[i]) != NULL;
    free(slashed);
    if (is_root)
        return error_set(e, ERROR_PATH_FORBIDDEN, "%s is an output root: name a directory below it", path);
    char *roots = mem_strdup("");
    for (size_t i = 0; i < outputs->root_count; i++) {
        char *longer = mem_printf("%s%s%s", roots, i ? ", " : "", outputs->roots[i]);
        free(roots);
        roots = longer;
    }
    error_set(
        e, ERROR_PATH_FORBIDDEN,
        "%s is outside the output roots of this service (setting output_roots: %s): name a directory below one "
        "of them",
        path, roots);
    free(roots);
    return false;
}

bool store_output_check(const store_outputs *outputs, const char *path, error *e)
{
    char name[NAME_MAX + 1];
    bool ok = true;
    for (const char *at = path; next_part(&at, name, &ok);) continue;
    if (!ok)
        return error_set(e, ERROR_PATH_FORBIDDEN,
                         "%s: the path contains \"..\" or a name that is too long: correct the path", path);
    for (size_t i = 0; i < outputs->root_count; i++)
        if (below(path, outputs->roots[i])) return true;
    return set_outside(outputs, path, e);
}

/* Whether the first component of the path is the name of the user, and another component follows. A first
 * component "." is refused: it would be the root itself. */
static bool is_of_user(const char *path, const char *user)
{
    char name[NAME_MAX + 1];
    bool ok;
    return next_part(&path, name, &ok) && strcmp(name, ".") != 0 && strcmp(name, user) == 0 &&
           next_part(&path, name, &ok);
}

bool store_output_check_user(const store_outputs *outputs, const char *user, const char *path, error *e)
{
    if (!store_output_check(outputs, path, e)) return false;
    const char *root = NULL;
    for (size_t i = 0; i < outputs->root_count; i++) {
        const char *rest = below(path, outputs->roots[i]);
        if (rest && (!outputs->of_user || !outputs->of_user[i] || is_of_user(rest, user))) return true;
        if (rest) root = outputs->roots[i];
    }
    return error_set(e, ERROR_PATH_FORBIDDEN,
                     "%s is outside the output root of the user %s: name a directory below %s/%s", path, user,
                     root, user);
}

static error_code code_of(int why)
{
    if (why == ELOOP || why == ENOTDIR) return ERROR_PATH_FORBIDDEN;
    return why == EROFS || why == EACCES || why == EPERM ? ERROR_OUTPUT_UNWRITABLE : error_code_of_errno(why);
}

/* The directory of the user on a path below a root of users; the caller frees it. NULL: the root is not a
 * root of users. */
static char *find_directory_of_user(const store_outputs *outputs, const char *path, char user[NAME_MAX + 1])
{
    const size_t index = outputs ? store_output_root_of(outputs, path) : 0;
    if (!outputs || !outputs->of_user || !outputs->of_user[index]) return NULL;
    const char *rest = below(path, outputs->roots[index]);
    bool ok;
    return next_part(&rest, user, &ok) ? mem_strndup(path, (size_t)(rest - path)) : NULL;
}

/* Why a call failed for the path, as denial_explain. The service must not make the directory of a user: the
 * user could not delete what is in it. */
static char *explain(const store_outputs *outputs, const char *path, int fault)
{
    char user[NAME_MAX + 1], *directory = find_directory_of_user(outputs, path, user);
    const bool is_denied = fault == EACCES || fault == EPERM;
    const bool is_missing = is_denied && directory && access(directory, F_OK) != 0 && errno == ENOENT;
    char *why = is_missing ? denial_describe_directory_of_user(directory, user) : NULL;
    char *text = why ? mem_printf(": %s", why) : denial_explain(path, fault, DENIAL_WRITE, "");
    free(why);
    free(directory);
    return text;
}

/* Sets the error of a failed call. `outputs` NULL: the path was not checked by store_output_check. */
static bool fail_below(const store_outputs *outputs, error *e, const char *what, const char *path)
{
    const int fault = errno;
    const char *root = outputs ? outputs->roots[store_output_root_of(outputs, path)] : path;
    char *why = fault == EROFS ? denial_describe_read_only(root) : explain(outputs, path, fault);
    const char *units = fault == EACCES || fault == EPERM
                            ? ". ReadWritePaths= in the unit of systemd must permit it, too"
                            : "";
    error_set(e, code_of(fault), "%s: %s: %s%s%s", path, what,
              fault == ELOOP ? "a symbolic link" : strerror(fault), why, units);
    free(why);
    return false;
}

static bool fail(error *e, const char *what, const char *path)
{
    return fail_below(NULL, e, what, path);
}

/* Sets the mode and group of a new file or directory, whatever the umask. */
static bool adopt(const store_outputs *outputs, int fd, mode_t mode)
{
    return (outputs->group == (gid_t)-1 || fchown(fd, (uid_t)-1, outputs->group) == 0) &&
           fchmod(fd, mode) == 0;
}

/* How missing directories are treated. */
typedef enum missing { MISSING_IS_ERROR, MISSING_IS_MADE, MISSING_ENDS } missing;

/* Makes and opens a directory in `here`. On failure returns -1 and sets errno. */
static int make_directory(const store_outputs *outputs, int here, const char *name)
{
    mode_t mode = outputs->mode | ((outputs->mode & 0444) >> 2);
    bool made = mkdirat(here, name, 0700) == 0;
    int next = made || errno == EEXIST ? openat(here, name, DIRECTORY) : -1;
    if (next >= 0 && made && (!adopt(outputs, next, mode) || fsync(here) != 0)) {
        int why = errno;
        close(next);
        errno = why;
        return -1;
    }
    return next;
}

size_t store_output_root_of(const store_outputs *outputs, const char *path)
{
    size_t i = 0;
    while (!below(path, outputs->roots[i])) i++;
    return i;
}

int store_output_open_root(const char *root, error *e)
{
    int fd = open(root, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0 && errno == EACCES) {
        fail(e, "the output root cannot be opened", root);
    } else if (fd < 0) {
        error_set(e, errno == ENOENT ? ERROR_OUTPUT_UNWRITABLE : code_of(errno),
                  "cannot open the output root %s: %s. Create it, or correct output_roots.", root,
                  strerror(errno));
    }
    return fd;
}

/* Opens the directory. With MISSING_ENDS it opens the deepest existing directory on the path; *whole is true
 * if this is the directory itself. Returns -1 on failure. */
static int open_directory(const store_outputs *outputs, const char *path, missing way, bool *whole, error *e)
{
    const char *root = outputs->roots[store_output_root_of(outputs, path)], *rest = below(path, root);
    int here = store_output_open_root(root, e);
    if (here < 0) return -1;
    char name[NAME_MAX + 1];
    bool ok = true;
    *whole = true;
    while (here >= 0 && next_part(&rest, name, &ok)) {
        int next = openat(here, name, DIRECTORY);
        if (next < 0 && errno == ENOENT && way == MISSING_ENDS) {
            *whole = false;
            return here;
        }
        if (next < 0 && errno == ENOENT && way == MISSING_IS_MADE) next = make_directory(outputs, here, name);
        int why = errno;
        close(here);
        errno = why;
        here = next;
    }
    if (here < 0)
        fail_below(outputs, e, way == MISSING_IS_MADE ? "cannot be created" : "cannot be opened", path);
    return here;
}

int store_output_open(const store_outputs *outputs, const char *path, error *e)
{
    bool whole;
    return store_output_check(outputs, path, e) ? open_directory(outputs, path, MISSING_IS_MADE, &whole, e)
                                                : -1;
}

int store_output_open_nearest(const store_outputs *outputs, const char *path, bool *whole, error *e)
{
    return store_output_check(outputs, path, e) ? open_directory(outputs, path, MISSING_ENDS, whole, e) : -1;
}

char *store_output_name(int directory)
{
    char link[64], name[PATH_MAX];
    snprintf(link, sizeof link, "/proc/self/fd/%d", directory);
    ssize_t length = readlink(link, name, sizeof name);
    return length > 0 && (size_t)length < sizeof name ? mem_strndup(name, (size_t)length) : NULL;
}

/* The file of store_output_try on a file system without unnamed files. */
#define TRIED_NAME ".probe.hexad-tmp"

bool store_output_try(const store_outputs *outputs, int directory, const char *path, error *e)
{
    int fd = openat(directory, ".", O_TMPFILE | O_WRONLY | O_CLOEXEC, 0600);
    const bool named = fd < 0 && (errno == EOPNOTSUPP || errno == EISDIR || errno == EINVAL);
    if (named) /* another user may have put a pipe there */
        fd = openat(directory, TRIED_NAME, O_WRONLY | O_CREAT | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC, 0600);
    if (fd < 0) return fail_below(outputs, e, "cannot be written", path);
    close(fd);
    /* another check may have removed it */
    return !named || unlinkat(directory, TRIED_NAME, 0) == 0 || errno == ENOENT ||
           fail_below(outputs, e, "cannot be written", path);
}

static bool has_directories(int directory)
{
    struct stat info;
    int fd = openat(directory, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    DIR *list = fd < 0 ? NULL : fdopendir(fd);
    bool found = false;
    if (!list && fd >= 0) close(fd);
    for (struct dirent *entry; list && !found && (entry = readdir(list));)
        found = strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0 &&
                fstatat(directory, entry->d_name, &info, AT_SYMLINK_NOFOLLOW) == 0 && S_ISDIR(info.st_mode);
    if (list) closedir(list);
    return found;
}

bool store_output_try_root(bool of_user, int directory, const char *root, error *e)
{
    error why = {0};
    if (store_output_try(NULL, directory, root, &why) || (of_user && has_directories(directory))) return true;
    if (e) *e = why;
    return false;
}

/* Copies bytes and hashes them. */
static bool copy_bytes(int from, int to, char hex[STORE_HASH_SIZE])
{
    char block[1 << 16];
    struct sha256_ctx context;
    sha256_init(&context);
    for (ssize_t got; (got = read(from, block, sizeof block)) != 0;) {
        if (got < 0 && errno == EINTR) continue;
        if (got < 0 || !transfer_write(to, block, (size_t)got)) return false;
        sha256_update(&context, (size_t)got, (const uint8_t *)block);
    }
    store_print_digest(&context, hex);
    return true;
}

/* *damaged: the file has another hash, and is not copied. Otherwise sets errno on failure. */
static bool copy_file(const store_outputs *outputs, int from, int to, const store_output_file *file,
                      const char *temporary, bool *damaged)
{
    char hex[STORE_HASH_SIZE];
    const char *name = file->name;
    int in = openat(from, name, O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
    if (in < 0) return false;
    unlinkat(to, temporary, 0); /* left by an interrupted copy */
    int out = openat(to, temporary, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
    bool ok = out >= 0 && copy_bytes(in, out, hex);
    *damaged = ok && *file->sha256 && strcmp(hex, file->sha256) != 0;
    ok = ok && !*damaged && adopt(outputs, out, outputs->mode) && store_flush(out);
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

bool store_output_copy(const store_outputs *outputs, const char *from, const store_output_file *files,
                       size_t count, int to, const char *path, const char *temporary, error *e)
{
    bool damaged = false;
    int source = open(from, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    bool ok = (source >= 0 || fail(e, "cannot be read", from)) &&
              (unlinkat(to, files[count - 1].name, 0) == 0 || errno == ENOENT ||
               fail_below(outputs, e, "cannot be replaced", path)) &&
              (fsync(to) == 0 || fail_below(outputs, e, "cannot be flushed", path));
    for (size_t i = 0; ok && i < count; i++) {
        if (i + 1 == count) ok = fsync(to) == 0 || fail_below(outputs, e, "cannot be flushed", path);
        if (ok && !copy_file(outputs, source, to, &files[i], temporary, &damaged))
            ok = damaged ? store_set_damaged(files[i].name, e) : fail_below(outputs, e, files[i].name, path);
    }
    ok = ok && (fsync(to) == 0 || fail_below(outputs, e, "cannot be flushed", path));
    if (source >= 0) close(source);
    return ok;
}

bool store_output_clear(const store_outputs *outputs, const char *path, const char *temporary, error *e)
{
    bool whole;
    if (!store_output_check(outputs, path, e)) return false;
    int directory = open_directory(outputs, path, MISSING_IS_ERROR, &whole, e);
    if (directory < 0) return false;
    bool ok = unlinkat(directory, temporary, 0) == 0 || errno == ENOENT ||
              fail_below(outputs, e, "a temporary file cannot be removed", path);
    close(directory);
    return ok;
}
