// SPDX-License-Identifier: Apache-2.0
/* path_map: translates paths of other machines into paths of this host.
 *
 * The map is a table of pairs of prefixes, `from` and `to`. A path is translated if its first components
 * equal a `from`. The longest matching `from` is used, and it is applied once. A Windows path begins with a
 * drive (`Z:`) or a share (`\\` or `//`). In Windows paths `/` equals `\`, and the case of ASCII letters is
 * ignored. Relative paths and names of uploaded files (files/sent_file.h) are not translated. Only the text
 * is compared and no file is opened. The code that opens the path checks for `..`. A map does not change
 * after it was read; any thread may use it.
 */
#ifndef HEXAD_FILES_PATH_MAP_H
#define HEXAD_FILES_PATH_MAP_H

#include <stddef.h>

#include "base/core/error.h"

typedef struct path_map path_map;

/* Reads `from=to` from each text. Returns NULL and the error spec_invalid in these cases: a text has another
 * form; a `from` or `to` is not absolute; a `from` is the root directory; a `from` appears twice. The caller
 * frees the map with path_map_free, which accepts NULL. */
path_map *path_map_read(const char *const *texts, size_t count, error *e);
void path_map_free(path_map *m);

/* The translated path, which the caller frees. NULL if no prefix matches or the path does not change. If `m`
 * is NULL, the table is empty. */
char *path_map_apply(const path_map *m, const char *path);

#endif
