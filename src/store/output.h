/* output: copies results into directories of users, below configured roots. results/output_place has the rules for that.
 *
 * A copy is a set of files. Each is written under a temporary name in its directory, flushed and renamed. The last file
 * marks the set as complete: it is removed first and written last. Missing directories are created. No symbolic
 * link below a root is followed, and other files there are not changed. No state; any thread.
 */
#ifndef HEXAD_STORE_OUTPUT_H
#define HEXAD_STORE_OUTPUT_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

#include "base/error.h"

typedef struct store_outputs {
    const char *const *roots; /* absolute */
    size_t root_count;
    mode_t mode; /* of files; created directories have execute permission wherever there is read permission */
    gid_t group; /* (gid_t)-1: stays */
    /* For each root, whether a user may use only the directory below it that has the user's name. NULL: no root is such. */
    const bool *of_user;
} store_outputs;

/* Whether a copy may go there: an error (path_forbidden) unless the path is absolute, below a root, and
 * without "..". Looks at the words only. */
bool store_output_check(const store_outputs *outputs, const char *path, error *e);

/* The same for a user. Below a root of users, the path must be below the directory of this user. */
bool store_output_check_user(const store_outputs *outputs, const char *user, const char *path, error *e);

/* The number of the root that a path lies below which store_output_check has accepted. */
size_t store_output_root_of(const store_outputs *outputs, const char *path);

/* Opens a root. -1 and an error: output_unwritable when there is none. */
int store_output_open_root(const char *root, error *e);

/* Opens the directory; missing ones are made. -1 and an error: path_forbidden, also of a symbolic link on the way;
 * output_unwritable (permissions, a read-only file system, no root); storage_full, storage_failed, internal. */
int store_output_open(const store_outputs *outputs, const char *path, error *e);

/* Opens the directory, or the last one on the way to it that exists; *whole: it is the directory itself. */
int store_output_open_nearest(const store_outputs *outputs, const char *path, bool *whole, error *e);

/* The path of an open directory without links, to be freed; NULL: not known. */
char *store_output_name(int directory);

/* Whether files can be made in an open directory: makes a hidden one and removes it. `path` is for the message. */
bool store_output_try(int directory, const char *path, error *e);

/* Copies the files of these names from the directory `from` to the open directory `to`; `path` is for messages.
 * `temporary` is a plain name that nothing else has in the directory: a process that is killed leaves at most a file of that
 * name. Copies into one directory must not overlap. Errors as store_output_open. */
bool store_output_copy(const store_outputs *outputs, const char *from, const char *const *names, size_t count,
                       int to, const char *path, const char *temporary, error *e);

/* Removes what a copy that was cut off has left. A file that is not there is no error; a directory that is not there
 * is one, since it may be on a disk that is away. */
bool store_output_clear(const store_outputs *outputs, const char *path, const char *temporary, error *e);

#endif
