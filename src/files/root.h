// SPDX-License-Identifier: Apache-2.0
/* root: opens input files below configured directories.
 *
 * A path from outside can reach only regular files below one of the roots. The kernel walks the path (openat2
 * with RESOLVE_BENEATH), so nothing can change between the check and the use. The kernel follows links that
 * stay below the root. A link that is absolute or leads out of the root may lead below a root again; render
 * farms often have such a link named `latest`. The text of such a link replaces the name of the link in the
 * path, repeatedly if necessary. The resulting path is opened by a walk that follows no link. Files that are
 * moved in the meantime therefore give no access.
 *
 * A root that is a file admits this file only, by its last component. In the directory of uploaded files
 * (files/sent_file.h) only uploaded files can be opened, and only by the name `sha256:HEX`. An extension
 * after the hash, `sha256:HEX.obj`, is ignored.
 *
 * Roots do not change after they were opened. Any thread may use them.
 */
#ifndef HEXAD_FILES_ROOT_H
#define HEXAD_FILES_ROOT_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/stat.h>

#include "base/core/error.h"

typedef struct store_roots store_roots;

/* Opens the directories or files. `sent` is the directory of uploaded files; NULL: none. It is searched
 * first. Returns NULL and the error input_missing if a root does not exist. The caller frees the roots with
 * store_roots_close, which accepts NULL. A `count` of 0 gives an empty set, which admits no file. */
store_roots *store_roots_open(const char *sent, const char *const *paths, size_t count, error *e);
void store_roots_close(store_roots *roots);

/* Records whether the setting input_roots has changed since the start. A restart applies the change; the
 * messages about paths outside the roots say so. Any thread may call this. */
void store_roots_note_change(store_roots *roots, bool changed);

/* Opens a file for reading. Returns its descriptor (close-on-exec), or -1 and an error:
 *   path_forbidden     the path is outside the roots or leads out of them
 *   input_missing      the file does not exist or cannot be read, or an uploaded file was removed
 *   input_unsupported  not a regular file, or a root, as "." is
 * An absolute path belongs to the root that it begins with. A relative path is tried below each root in
 * order. If `roots` is NULL (a worker without a daemon), the path is opened as it is. */
int store_open_input(const store_roots *roots, const char *path, error *e);

/* As store_open_input, and also opens a directory. Files below the directory can be opened with openat; the
 * directory itself need not be readable. */
int store_open_place(const store_roots *roots, const char *path, bool *is_directory, error *e);

/* As store_open_input, for a directory that can be read. The directory of uploaded files cannot be opened. */
int store_open_directory(const store_roots *roots, const char *path, error *e);

/* Whether the path is a directory or a regular file. If so, *info is its status. */
bool store_find_input(const store_roots *roots, const char *path, struct stat *info);

/* The path of a root as configured; NULL if `index` is not less than the number of roots. *directory is false
 * if the root is a single file. */
const char *store_roots_name(const store_roots *roots, size_t index, bool *directory);

/* Opens the file at the relative `path` below `directory` by a walk that follows no link. The same walk is
 * used on kernels without openat2. On failure returns -1 and sets errno (EXDEV: the path leads out or
 * contains a symbolic link). */
int store_open_walking(int directory, const char *path);

#endif
