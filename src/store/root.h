/* root: input files, opened beneath configured directories.
 *
 * A path from outside may only reach regular files below one of the roots. The kernel walks (openat2 with
 * RESOLVE_BENEATH), so there is no moment between check and use; it follows links that stay below the root. A
 * link that is absolute, or leads out of the root, may lead below a root again, as `latest` does on farms. It
 * is read as text and put in place of its name, as often as there are links; what comes of it is opened by a
 * walk that follows no link at all. So moving files meanwhile gives no access.
 *
 * A root that is a file stands for itself alone, named by its last part. In the directory of uploaded files
 * (store/inputs.h) only these can be opened, and only by the name `sha256:HEX`; an ending behind the hash,
 * `sha256:HEX.obj`, is not looked at.
 *
 * Roots are immutable once opened and may be used by any thread.
 */
#ifndef HEXAD_STORE_ROOT_H
#define HEXAD_STORE_ROOT_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/stat.h>

#include "base/error.h"

typedef struct store_roots store_roots;

/* Opens the directories or files. `sent` is the directory of files that clients have sent, NULL: none; it is
 * searched first. NULL and an error (input_missing) when one is not there. The caller
 * releases with store_roots_close, which accepts NULL. A count of 0 gives an empty set, which
 * admits nothing. */
store_roots *store_roots_open(const char *sent, const char *const *paths, size_t count, error *e);
void store_roots_close(store_roots *roots);

/* Whether the setting input_roots has changed since the start, which a restart applies. The messages on paths outside of the
 * roots say so. Any thread may call this. */
void store_roots_note_change(store_roots *roots, bool changed);

/* Opens a file for reading and returns its descriptor (close-on-exec), or -1 and an error:
 * path_forbidden   the path is outside the roots or leads out of them
 * input_missing    nothing readable is there, or what a client had sent is gone
 * input_unsupported  not a regular file
 * An absolute path belongs to the root that it begins with; a relative one is tried under each root
 * in order. With `roots` NULL (a worker without a daemon) the path is opened as it is. */
int store_open_input(const store_roots *roots, const char *path, error *e);

/* The same for what may be a file, or a directory below which files are opened (openat): it cannot be read itself. */
int store_open_place(const store_roots *roots, const char *path, bool *is_directory, error *e);

/* The same for a directory that can be read. Files that clients have sent are in none. */
int store_open_directory(const store_roots *roots, const char *path, error *e);

/* Whether a directory or a regular file is at the path; then what is known of it. */
bool store_find_input(const store_roots *roots, const char *path, struct stat *info);

/* The path of a root as configured, NULL behind the last one. *directory: it is not a single file. */
const char *store_roots_name(const store_roots *roots, size_t index, bool *directory);

/* Opens the file at the relative `path` beneath `directory` by a walk that follows no link, as on kernels without openat2. -1 and errno on
 * failure (EXDEV: leads out, or a symbolic link). */
int store_open_walking(int directory, const char *path);

#endif
