// SPDX-License-Identifier: Apache-2.0
/* output: copies results into directories of users, below configured roots. service/results/output_place has
 * the rules for that.
 *
 * A copy is a set of files. Each file is written under a temporary name in its directory, flushed and
 * renamed. The last file marks the set as complete: it is removed first and written last. Missing directories
 * are created. Symbolic links below a root are not followed. Other files in the directory are not changed.
 * The functions keep no state; any thread may call them.
 */
#ifndef HEXAD_FILES_OUTPUT_H
#define HEXAD_FILES_OUTPUT_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

#include "base/core/error.h"

typedef struct store_outputs {
    const char *const *roots; /* absolute */
    size_t root_count;
    /* mode of created files; created directories also have execute permission for all that may read them */
    mode_t mode;
    gid_t group; /* group of created files; (gid_t)-1: not changed */
    /* Per root: users may use only the directory below it that has their name. NULL: false for all roots. */
    const bool *of_user;
} store_outputs;

/* Checks that a path is absolute, below a root, and without "..". Otherwise returns false and the error
 * path_forbidden. Only the text of the path is examined. */
bool store_output_check(const store_outputs *outputs, const char *path, error *e);

/* store_output_check for a user: below a root of users, the path must be below the directory of this user. */
bool store_output_check_user(const store_outputs *outputs, const char *user, const char *path, error *e);

/* The index of the root of a path that store_output_check has accepted. */
size_t store_output_root_of(const store_outputs *outputs, const char *path);

/* Opens a root. Returns -1 and the error output_unwritable if the root does not exist. */
int store_output_open_root(const char *root, error *e);

/* Opens the directory and makes missing directories. On failure returns -1 and an error: path_forbidden (also
 * for a symbolic link on the way), output_unwritable (permissions, a read-only file system, no root),
 * storage_full, storage_failed or internal. */
int store_output_open(const store_outputs *outputs, const char *path, error *e);

/* Opens the directory or, if it does not exist, its nearest existing parent. *whole: the directory itself was
 * opened. */
int store_output_open_nearest(const store_outputs *outputs, const char *path, bool *whole, error *e);

/* The path of an open directory with symbolic links resolved, or NULL if it cannot be read. The caller
 * frees it. */
char *store_output_name(int directory);

/* Checks that files can be made in an open directory: makes a file without a name. On a file system that has
 * no such files, it makes a hidden one and removes it. `path`, below a root or with `outputs` NULL, is for
 * the message. */
bool store_output_try(const store_outputs *outputs, int directory, const char *path, error *e);

/* As store_output_try, for an output root. A root with a directory for each user need not be writable if it
 * has directories: the administrator makes them. */
bool store_output_try_root(bool of_user, int directory, const char *root, error *e);

/* A file to copy. */
typedef struct store_output_file {
    const char *name;
    const char *sha256; /* in hexadecimal digits; "": unknown */
} store_output_file;

/* Copies files from the directory `from` to the open directory `to`; `path` is for messages. The bytes are
 * hashed while they are copied, and a file gets its name only if it has the hash. `temporary` is a plain name
 * that no other file in the directory has. A process that is killed leaves at most a file of this name. Copies
 * into one directory must not overlap. Errors are those of store_output_open, and input_damaged: a file
 * has another hash. */
bool store_output_copy(const store_outputs *outputs, const char *from, const store_output_file *files,
                       size_t count, int to, const char *path, const char *temporary, error *e);

/* Removes the temporary file of an interrupted copy. If the file is missing, returns true. If the directory
 * is missing, returns false and an error, because the directory may be on a disk that is not mounted. */
bool store_output_clear(const store_outputs *outputs, const char *path, const char *temporary, error *e);

#endif
