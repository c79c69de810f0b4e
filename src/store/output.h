/* output: copies results into directories of users, below configured roots.
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
    mode_t mode; /* of files; directories that are made can be searched, too, by who may read */
    gid_t group; /* (gid_t)-1: stays */
} store_outputs;

/* Whether a copy may go there: an error (path_forbidden) unless the path is absolute, below a root, and
 * without "..". Looks at the words only. */
bool store_output_check(const store_outputs *outputs, const char *path, error *e);

/* Copies the files of these names. `temporary` is a plain name that nothing else has in the directory: a process that
 * is killed leaves at most a file of that name. Errors: path_forbidden, also of a symbolic link on the way;
 * storage_full, storage_failed, internal. */
bool store_output_copy(const store_outputs *outputs, const char *from, const char *const *names, size_t count,
                       const char *path, const char *temporary, error *e);

/* Removes what a copy that was cut off has left. A file that is not there is no error; a directory that is not there
 * is one, since it may be on a disk that is away. */
bool store_output_clear(const store_outputs *outputs, const char *path, const char *temporary, error *e);

#endif
