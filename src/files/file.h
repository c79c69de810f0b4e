// SPDX-License-Identifier: Apache-2.0
/* file: writes, reads, renames and removes files and directories of the service. A crash leaves the old or
 * the new file, never a part of it.
 *
 * A file is written in its directory under a temporary name. It is flushed to disk and renamed, and its
 * directory is flushed. A file of a job is then read from the disk again and compared with hashes of what was
 * written (hashed_stream.h). Errors have the code storage_full, storage_failed or internal and name the path
 * and the cause. The functions keep no state. Any thread may call them; a store_file belongs to one thread.
 */
#ifndef HEXAD_FILES_FILE_H
#define HEXAD_FILES_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "base/core/error.h"
#include "files/hashed_stream.h"

typedef struct store_file {
    FILE *stream; /* stream to write to; owned by the store_file */
    char *path, *temporary;
    hashed_stream *hashes; /* of what is written; owned by the stream. NULL except after begin_hashed */
} store_file;

/* Opens the temporary file for reading and writing. After success the caller calls exactly one of commit,
 * place and abort. Each of them leaves *file empty. If commit or place fails, the temporary file has been
 * removed. Abort accepts an empty file. */
bool store_file_begin(const char *path, store_file *file, error *e);
/* Like begin, for a file whose bytes are hashed while they are written. The stream only writes and has no
 * descriptor. */
bool store_file_begin_hashed(const char *path, store_file *file, error *e);
bool store_file_commit(store_file *file, error *e);
/* Like commit, without flushing the directory. The caller flushes the directory once for all its files. */
bool store_file_place(store_file *file, error *e);
/* Flushes the written bytes to disk. This is the first and slowest step of commit. If it is called earlier,
 * commit has little left to do. After a failure the caller calls abort. */
bool store_file_flush(store_file *file, error *e);
void store_file_abort(store_file *file);

/* Removes the temporary files for `path` that were neither committed nor aborted. Their processes must have
 * ended, or be about to end. Files are recognised by name only. */
void store_file_clear(const char *path);

/* Whether `name` is that of a temporary file for the file `of`; both are names without a directory. */
bool store_file_is_temporary(const char *name, const char *of);

/* Calls begin, writes the bytes and calls commit. */
bool store_file_write(const char *path, const void *bytes, size_t count, error *e);

/* Reads a whole file. Returns its bytes and a NUL; the caller frees them. *count excludes the NUL. A file of
 * more than `limit` bytes is an error. On failure errno is set, too. */
char *store_file_read(const char *path, size_t limit, size_t *count, error *e);
/* The same for a stream, from its position to its end. On failure errno is set: EFBIG, or as of fread. */
char *store_stream_read(FILE *stream, size_t limit, size_t *count);

/* Checks that only the user of the service and root can access an open file. Otherwise returns false and the
 * error spec_invalid. Root can show the service a file by making it readable for its group. The group must be
 * the process's own, or root if an access control list gives the permission. If the process runs as root, any
 * group is accepted. */
bool store_file_check_private(int fd, const char *path, error *e);

/* Facts of a stored file, for clients. */
#define STORE_HASH_SIZE 65
typedef struct store_facts {
    char sha256[STORE_HASH_SIZE];
    uint64_t bytes;
} store_facts;

/* Like place, for a file of begin_hashed. Flushes the file, drops it from the page cache, reads it again and
 * compares it with the hashes of what was written. A difference is the error storage_failed. File systems in
 * memory (tmpfs) keep the pages: the bytes in memory are compared. `out` NULL: the facts are not needed,
 * which saves a hash. */
bool store_file_place_verified(store_file *file, store_facts *out, error *e);

/* SHA-256 in hexadecimal digits, of bytes and of an open file. store_file_hash reads the file from its
 * beginning and does not move the offset of `fd`. *bytes is the number of bytes read. */
void store_hash(const void *bytes, size_t count, char hex[STORE_HASH_SIZE]);
bool store_file_hash(int fd, char hex[STORE_HASH_SIZE], uint64_t *bytes, error *e);
/* A time at which reading ends early, of clock_monotonic_ms. Another thread may change it. */
typedef _Atomic int64_t store_deadline;
/* As store_file_hash, until the deadline (NULL: none): then the error limit_time. */
bool store_file_hash_until(int fd, const store_deadline *end, char hex[STORE_HASH_SIZE], uint64_t *bytes,
                           error *e);
/* Ends a hash that was computed in pieces. */
struct sha256_ctx;
void store_print_digest(struct sha256_ctx *context, char hex[STORE_HASH_SIZE]);

/* Sets the error input_damaged: the bytes of a file of a result do not have the hash that was stored with them.
 * Returns false. */
bool store_set_damaged(const char *name, error *e);

/* Identifies a file and its last change on any host that mounts its file system. A change of the bytes
 * changes the identity. */
typedef struct store_identity {
    uint64_t bytes, inode;
    int64_t mtime_ns, ctime_ns;
} store_identity;

/* The identity of an open file. False if fstat fails. */
bool store_identify(int fd, store_identity *out);
bool store_identity_equals(const store_identity *a, const store_identity *b);

/* Makes a directory and its missing parents with mode 0777 less the umask. If the directory exists,
 * returns true. */
bool store_directory_create(const char *path, error *e);
/* Makes a directory in an existing one. Use it while the service runs: a state directory that was moved away,
 * or a file system that was unmounted, must not be replaced by an empty directory. If the directory
 * exists, returns true. */
bool store_directory_add(const char *path, error *e);

/* Whether a command may put a new result there: nothing is at the path or, if `empty_too`, a directory without
 * entries. The message otherwise is STORE_DIRECTORY_TAKEN with the path. */
bool store_directory_is_free(const char *path, bool empty_too);
#define STORE_DIRECTORY_TAKEN "%s exists: name another directory for the result with --output"

/* Flushes a file to disk. A large file is flushed in pieces, so that flushes of other files need not wait for
 * all of it. On failure returns false and sets errno. */
bool store_flush(int fd);

/* The directory of a path, which the caller frees. */
char *store_parent_of(const char *path);
/* Flushes the entries of a directory to disk. */
bool store_directory_sync(const char *path, error *e);

/* Renames and flushes both parent directories. `to` must not exist, or must be an empty directory. */
bool store_rename(const char *from, const char *to, error *e);

/* Removes a file, or a directory and its contents, and flushes the parent directory. Symbolic links are
 * removed, not followed. If the path does not exist, returns true. */
bool store_remove(const char *path, error *e);

#endif
