// SPDX-License-Identifier: Apache-2.0
#include "files/file.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <nettle/sha2.h>

#include "base/core/clock.h"
#include "base/core/denial.h"
#include "base/core/hex.h"
#include "base/core/memory.h"
#include "base/core/transfer.h"

/* Bytes that store_flush writes at a time. Pieces of 1 to 16 MB delay other flushes by at most 40 ms on a
 * disk of 350 MB/s; a whole file of 235 MB delays them by 120 ms. */
#define PIECE (8 << 20)
#define WRITE_AND_WAIT (SYNC_FILE_RANGE_WAIT_BEFORE | SYNC_FILE_RANGE_WRITE | SYNC_FILE_RANGE_WAIT_AFTER)

/* The instruction in the message about a failed system call. */
static const char *remedy_of(int why)
{
    if (why == ENOENT || why == ENOTDIR || why == EISDIR) return ". Check the path.";
    if (why == EACCES || why == EPERM || why == EROFS) return ". Check the permissions.";
    return why == ENOSPC || why == EDQUOT ? ". Free some space." : "";
}

static bool fail(error *e, const char *what, const char *path)
{
    const int why = errno;
    error_set(e, error_code_of_errno(why), "cannot %s %s: %s%s", what, path, strerror(why), remedy_of(why));
    errno = why;
    return false;
}

char *store_parent_of(const char *path)
{
    size_t length = strlen(path);
    while (length > 1 && path[length - 1] == '/') length--;
    while (length > 0 && path[length - 1] != '/') length--;
    while (length > 1 && path[length - 1] == '/') length--;
    return length ? mem_strndup(path, length) : mem_strdup(".");
}

bool store_directory_sync(const char *path, error *e)
{
    int fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0) return fail(e, "open", path);
    bool ok = fsync(fd) == 0 || fail(e, "flush", path);
    close(fd);
    return ok;
}

static bool parent_sync(const char *path, error *e)
{
    char *parent = store_parent_of(path);
    bool ok = store_directory_sync(parent, e);
    free(parent);
    return ok;
}

/* The name of a temporary file is the final name, a point, and RANDOM_DIGITS hexadecimal digits. */
enum { RANDOM_DIGITS = 16 };

bool store_file_is_temporary(const char *name, const char *of)
{
    size_t length = strlen(of);
    return strncmp(name, of, length) == 0 && name[length] == '.' &&
           strspn(name + length + 1, "0123456789abcdef") == RANDOM_DIGITS &&
           name[length + 1 + RANDOM_DIGITS] == '\0';
}

void store_file_clear(const char *path)
{
    char *parent = store_parent_of(path);
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
    DIR *listing = opendir(parent);
    for (struct dirent *entry; listing && (entry = readdir(listing));)
        if (store_file_is_temporary(entry->d_name, name)) unlinkat(dirfd(listing), entry->d_name, 0);
    if (listing) closedir(listing);
    free(parent);
}

static bool begin(const char *path, bool is_hashed, store_file *file, error *e)
{
    uint64_t random = 0;
    if (getrandom(&random, sizeof random, 0) != sizeof random) return fail(e, "create", path);
    char *temporary = mem_printf("%s.%0*" PRIx64, path, RANDOM_DIGITS, random);
    /* mkstemp would give mode 0600 regardless of the umask */
    int fd = open(temporary, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (fd < 0) {
        fail(e, "create", path);
        free(temporary);
        return false;
    }
    hashed_stream *hashes = NULL;
    FILE *stream = is_hashed ? hashed_stream_open(fd, &hashes) : fdopen(fd, "w+b");
    if (!stream) {
        fail(e, "create", path);
        close(fd);
        unlink(temporary);
        free(temporary);
        return false;
    }
    *file = (store_file){stream, mem_strdup(path), temporary, hashes};
    return true;
}

bool store_file_begin(const char *path, store_file *file, error *e)
{
    return begin(path, false, file, e);
}

bool store_file_begin_hashed(const char *path, store_file *file, error *e)
{
    return begin(path, true, file, e);
}

static int descriptor_of(const store_file *file)
{
    return file->hashes ? hashed_stream_descriptor(file->hashes) : fileno(file->stream);
}

void store_file_abort(store_file *file)
{
    if (file->stream) fclose(file->stream);
    if (file->temporary) unlink(file->temporary);
    free(file->temporary);
    free(file->path);
    *file = (store_file){0};
}

/* A stream stores that a write failed, without the cause. The cause is found by another failing write; the
 * file is discarded. */
static int find_cause(FILE *stream)
{
    clearerr(stream);
    errno = 0;
    return (fputc(0, stream) == EOF || fflush(stream) != 0) && errno ? errno : EIO;
}

bool store_flush(int fd)
{
    struct stat info;
    if (fstat(fd, &info) != 0) return false;
    /* fsync does not report an error that sync_file_range has already reported */
    for (off_t at = 0; at + PIECE < info.st_size; at += PIECE)
        if (sync_file_range(fd, at, PIECE, WRITE_AND_WAIT) != 0) return false;
    return fsync(fd) == 0;
}

bool store_file_flush(store_file *file, error *e)
{
    /* fflush may succeed although an earlier write failed */
    bool failed = ferror(file->stream) != 0;
    if (!failed && fflush(file->stream) == 0 && store_flush(descriptor_of(file))) return true;
    if (failed) errno = find_cause(file->stream);
    if (!errno) errno = EIO;
    return fail(e, "write", file->path);
}

/* Closes a flushed file and renames it. */
static bool rename_flushed(store_file *file, error *e)
{
    bool ok = false;
    int closed = fclose(file->stream);
    file->stream = NULL;
    if (closed != 0) {
        fail(e, "write", file->path);
        goto done;
    }
    if (rename(file->temporary, file->path) != 0) {
        fail(e, "replace", file->path);
        goto done;
    }
    free(file->temporary);
    file->temporary = NULL;
    ok = true;
done:
    store_file_abort(file);
    return ok;
}

bool store_file_place(store_file *file, error *e)
{
    if (store_file_flush(file, e)) return rename_flushed(file, e);
    store_file_abort(file);
    return false;
}

bool store_file_commit(store_file *file, error *e)
{
    char *path = mem_strdup(file->path);
    const bool ok = store_file_place(file, e) && parent_sync(path, e);
    free(path);
    return ok;
}

bool store_file_write(const char *path, const void *bytes, size_t count, error *e)
{
    store_file file = {0};
    if (!store_file_begin(path, &file, e)) return false;
    fwrite(bytes, 1, count, file.stream); /* commit checks the stream's error flag */
    return store_file_commit(&file, e);
}

char *store_stream_read(FILE *stream, size_t limit, size_t *count)
{
    size_t used = 0, capacity = 0, got;
    char *text = NULL;
    do {
        if (capacity - used < 65536) text = mem_resize(text, (capacity = used * 2 + 65537));
        got = fread(text + used, 1, capacity - used - 1, stream);
        used += got;
    } while (got > 0 && used <= limit);
    if (!ferror(stream) && used <= limit) {
        text[used] = '\0';
        *count = used;
        return text;
    }
    const int why = ferror(stream) ? errno : EFBIG;
    free(text);
    errno = why;
    return NULL;
}

char *store_file_read(const char *path, size_t limit, size_t *count, error *e)
{
    FILE *stream = fopen(path, "rbe");
    char *text = stream ? store_stream_read(stream, limit, count) : NULL;
    const int why = errno;
    if (stream) fclose(stream);
    errno = why;
    if (!text) fail(e, "read", path);
    return text;
}

void store_print_digest(struct sha256_ctx *context, char hex[STORE_HASH_SIZE])
{
    uint8_t digest[SHA256_DIGEST_SIZE];
    sha256_digest(context, sizeof digest, digest);
    hex_print(digest, sizeof digest, hex);
}

bool store_file_check_private(int fd, const char *path, error *e)
{
    struct stat info;
    if (fstat(fd, &info) != 0 || !S_ISREG(info.st_mode))
        return error_set(e, ERROR_SPEC_INVALID, "%s is not a regular file", path);
    /* With an access control list the group permissions are those of the list; the group is root, even if
     * another one was set. */
    bool is_our_group = geteuid() == 0 || info.st_gid == 0 || info.st_gid == getegid();
    mode_t allowed = info.st_uid == 0 && is_our_group ? 0740 : 0700;
    const bool is_ours = info.st_uid == geteuid() || info.st_uid == 0;
    if (is_ours && !(info.st_mode & 0777 & ~allowed)) return true;
    char *why = denial_describe(path, DENIAL_SECRET);
    error_set(e, ERROR_SPEC_INVALID, "%s: %s: %s", path,
              is_ours ? "other users can access the file" : "the file belongs to another user", why);
    free(why);
    return false;
}

void store_hash(const void *bytes, size_t count, char hex[STORE_HASH_SIZE])
{
    struct sha256_ctx context;
    sha256_init(&context);
    sha256_update(&context, count, bytes);
    store_print_digest(&context, hex);
}

/* Bytes that are read at a time for a hash: a multiple of the blocks of hashed_stream. */
enum { READ_BYTES = 64 * HASHED_STREAM_BLOCK };

/* Compares `count` bytes, read from a multiple of the block's length, with the written ones. `bytes` has
 * space for whole blocks. Returns the first byte of the first block that differs; UINT64_MAX if none
 * differs. */
static uint64_t first_difference(hashed_stream *written, uint64_t at, unsigned char *bytes, size_t count)
{
    const size_t rest = count % HASHED_STREAM_BLOCK;
    if (rest) memset(bytes + count, 0, HASHED_STREAM_BLOCK - rest);
    for (size_t k = 0; k < count; k += HASHED_STREAM_BLOCK)
        if (!hashed_stream_has(written, (at + k) / HASHED_STREAM_BLOCK, bytes + k)) return at + k;
    return UINT64_MAX;
}

/* Reads a file: hashes it if `hex` is not NULL, and compares it if `written` is not NULL. *differs is as of
 * first_difference. False: it cannot be read. */
static bool read_file(int fd, hashed_stream *written, const store_deadline *end, char *hex, uint64_t *bytes,
                      uint64_t *differs, error *e)
{
    struct sha256_ctx context;
    unsigned char *block = mem_resize(NULL, READ_BYTES); /* a small file touches few of its pages */
    uint64_t total = 0;
    int64_t got;
    bool late = false;
    *differs = UINT64_MAX;
    sha256_init(&context);
    do {
        late = end && clock_monotonic_ms() >= atomic_load(end);
        if (late) break;
        got = transfer_read_at(fd, block, READ_BYTES, total);
        if (got <= 0) break;
        if (hex) sha256_update(&context, (size_t)got, block);
        if (written && *differs == UINT64_MAX)
            *differs = first_difference(written, total, block, (size_t)got);
        total += (uint64_t)got;
    } while (got == READ_BYTES);
    const int why = errno;
    free(block);
    if (late) return error_set(e, ERROR_LIMIT_TIME, "there was no time to read a file for its hash");
    if (got < 0)
        return error_set(e, error_code_of_errno(why), "a file cannot be read for its hash: %s",
                         strerror(why));
    if (hex) store_print_digest(&context, hex);
    *bytes = total;
    return true;
}

bool store_file_hash_until(int fd, const store_deadline *end, char hex[STORE_HASH_SIZE], uint64_t *bytes,
                           error *e)
{
    uint64_t unused;
    return read_file(fd, NULL, end, hex, bytes, &unused, e);
}

bool store_file_hash(int fd, char hex[STORE_HASH_SIZE], uint64_t *bytes, error *e)
{
    return store_file_hash_until(fd, NULL, hex, bytes, e);
}

bool store_set_damaged(const char *name, error *e)
{
    return error_set(e, ERROR_INPUT_DAMAGED,
                     "the result file %s is damaged: its bytes have changed since it was written (SHA-256). "
                     "Submit the job again, which computes it again.",
                     name);
}

/* Reads a flushed file from the disk and compares it with what was written. */
static bool verify(const store_file *file, char *hex, uint64_t *bytes, error *e)
{
    const uint64_t length = hashed_stream_length(file->hashes);
    uint64_t differs;
    /* Advice only: file systems in memory keep the pages. */
    posix_fadvise(descriptor_of(file), 0, 0, POSIX_FADV_DONTNEED);
    if (!read_file(descriptor_of(file), file->hashes, NULL, hex, bytes, &differs, e))
        return error_prefix(e, "%s", file->path);
    if (differs == UINT64_MAX && *bytes == length) return true;
    if (differs == UINT64_MAX) differs = length < *bytes ? length : *bytes;
    return error_set(e, ERROR_STORAGE_FAILED,
                     "%s differs from the written data from byte %" PRIu64
                     " on when it is read back: check the disk, its connection and the kernel's log",
                     file->path, differs);
}

bool store_file_place_verified(store_file *file, store_facts *out, error *e)
{
    store_facts facts;
    if (!store_file_flush(file, e) || !verify(file, out ? facts.sha256 : NULL, &facts.bytes, e)) {
        store_file_abort(file);
        return false;
    }
    if (out) *out = facts;
    return rename_flushed(file, e);
}

static int64_t ns_of(struct timespec t)
{
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

bool store_identify(int fd, store_identity *out)
{
    struct stat info;
    if (fstat(fd, &info) != 0) return false;
    *out = (store_identity){(uint64_t)info.st_size, (uint64_t)info.st_ino, ns_of(info.st_mtim),
                            ns_of(info.st_ctim)};
    return true;
}

bool store_identity_equals(const store_identity *a, const store_identity *b)
{
    return a->bytes == b->bytes && a->inode == b->inode && a->mtime_ns == b->mtime_ns &&
           a->ctime_ns == b->ctime_ns;
}

bool store_directory_add(const char *path, error *e)
{
    struct stat info;
    if (mkdir(path, 0777) == 0) return parent_sync(path, e);
    if (errno == EEXIST && stat(path, &info) == 0) {
        if (S_ISDIR(info.st_mode)) return true;
        errno = ENOTDIR;
    }
    return fail(e, "create the directory", path);
}

bool store_directory_create(const char *path, error *e)
{
    struct stat info;
    char *parent = store_parent_of(path);
    bool ok = !*path || strcmp(parent, path) == 0 || stat(parent, &info) == 0 || errno != ENOENT ||
              store_directory_create(parent, e);
    free(parent);
    return ok && store_directory_add(path, e);
}

bool store_directory_is_free(const char *path, bool empty_too)
{
    struct stat info;
    size_t entries = 0;
    if (lstat(path, &info) != 0) return errno == ENOENT;
    DIR *d = empty_too ? opendir(path) : NULL;
    if (!d) return false;
    for (const struct dirent *entry; (entry = readdir(d));)
        entries += strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0;
    closedir(d);
    return entries == 0;
}

bool store_rename(const char *from, const char *to, error *e)
{
    if (rename(from, to) != 0)
        return error_set(e, error_code_of_errno(errno), "%s cannot be renamed to %s: %s", from, to,
                         strerror(errno));
    return parent_sync(to, e) && parent_sync(from, e);
}

/* Takes over `directory`. The process's limit of descriptors bounds the depth. */
static bool remove_contents(int directory)
{
    DIR *listing = fdopendir(directory);
    if (!listing) {
        close(directory);
        return false;
    }
    bool ok = true;
    struct dirent *entry;
    while (ok && (entry = readdir(listing))) {
        if (strcmp(entry->d_name, ".") == 0 || strcmp(entry->d_name, "..") == 0) continue;
        if (unlinkat(directory, entry->d_name, 0) == 0 || errno == ENOENT) continue;
        int inner = openat(directory, entry->d_name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
        ok = inner >= 0 && remove_contents(inner) &&
             (unlinkat(directory, entry->d_name, AT_REMOVEDIR) == 0 || errno == ENOENT);
    }
    int why = errno;
    closedir(listing);
    errno = why;
    return ok;
}

bool store_remove(const char *path, error *e)
{
    if (unlink(path) == 0) return parent_sync(path, e);
    if (errno == ENOENT) return true;
    int directory = open(path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (directory < 0 || !remove_contents(directory) || rmdir(path) != 0) {
        if (errno == ENOENT) return true;
        return fail(e, "remove", path);
    }
    return parent_sync(path, e);
}
