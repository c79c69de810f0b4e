/* file: files and directories that the service owns, written so that a crash leaves the old or the new, never a part.
 *
 * A file is written beside its place under a temporary name, flushed to disk, renamed, and its directory flushed. Errors
 * have code storage_full, storage_failed or internal and name the path and the cause. The functions keep no state and
 * may be called by any thread; a store_file belongs to one thread.
 */
#ifndef HEXAD_STORE_FILE_H
#define HEXAD_STORE_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "base/error.h"

typedef struct store_file {
    FILE *stream; /* where to write; owned by the store_file */
    char *path, *temporary;
} store_file;

/* Opens the temporary file, readable and writable. After success exactly one of commit and abort
 * follows; both leave *file empty. Commit that fails has aborted. Abort accepts an empty file. */
bool store_file_begin(const char *path, store_file *file, error *e);
bool store_file_commit(store_file *file, error *e);
/* As commit, but the directory is the caller's to flush, once for all files that go there. */
bool store_file_place(store_file *file, error *e);
/* Brings to disk what was written. It is the first and slowest step of commit; called before, it leaves commit little to
 * do. After a failure abort follows. */
bool store_file_flush(store_file *file, error *e);
/* Lets the disk begin with what has left the stream (flush that first), while the caller goes on. A wish: nothing is promised. */
void store_file_begin_flush(store_file *file);
void store_file_abort(store_file *file);

/* Removes what files for `path` that were begun but neither committed nor aborted have left beside it, when
 * their process is over or about to be. Names are looked at, nothing else. */
void store_file_clear(const char *path);

/* begin, write, commit. */
bool store_file_write(const char *path, const void *bytes, size_t count, error *e);

/* The whole of a file, NUL-terminated, to be freed; an error when it has more than `limit` bytes.
 */
char *store_file_read(const char *path, size_t limit, size_t *count, error *e);

/* Whether only the service and root can write and read an open file; else an error (spec_invalid).
 * A file of root may let its group read, which is how root shows it to the service: that has to be the process's
 * own group, or root's with an access control list. To root any group will do. */
bool store_file_check_private(int fd, const char *path, error *e);

/* SHA-256 of bytes; and of an open file, with its length, from its beginning; the offset of `fd` is not
 * moved. */
#define STORE_HASH_SIZE 65
void store_hash(const void *bytes, size_t count, char hex[STORE_HASH_SIZE]);
bool store_file_hash(int fd, char hex[STORE_HASH_SIZE], uint64_t *bytes, error *e);

/* Which file it is, on any host that sees it, and when it was changed last. A change of the bytes changes it. */
typedef struct store_identity {
    uint64_t bytes, inode;
    int64_t mtime_ns, ctime_ns;
} store_identity;

/* The identity of an open file. False: it cannot be examined. */
bool store_identify(int fd, store_identity *out);
bool store_identity_equals(const store_identity *a, const store_identity *b);

/* Facts of a stored file, for clients. */
typedef struct store_facts {
    char sha256[STORE_HASH_SIZE];
    uint64_t bytes;
} store_facts;

/* Makes a directory, and what is missing above it, with mode 0777 less the umask; one that is there
 * is no error. */
bool store_directory_create(const char *path, error *e);

/* Flushes a file to disk, a large one piece by piece, so that flushes of other files do not wait for all of it. False:
 * errno. */
bool store_flush(int fd);

/* Flushes the names in a directory to disk. */
bool store_directory_sync(const char *path, error *e);

/* Renames and flushes both parent directories. `to` must not be there, or be an empty directory. */
bool store_rename(const char *from, const char *to, error *e);

/* Removes a file or a directory with all that is in it, and flushes the name's end to disk; symbolic
 * links are not followed. Nothing there is no error. */
bool store_remove(const char *path, error *e);

#endif
