/* path_map: what directories of other machines are called here.
 *
 * A table of prefixes. A path is mapped when its first components are those of a `from`; of several the
 * longest is taken, once. Paths of Windows, which begin with a drive (`Z:`) or with `\\` or `//` (a share),
 * have `/` and `\` for the same, and their prefixes are compared without regard to the case of ASCII letters.
 * Relative paths and the names of files that were sent (store/inputs.h) begin with no `from`. Words only, no
 * file is looked at: a `..` behind the prefix is left to whoever opens the path. Immutable once read; any
 * thread.
 */
#ifndef HEXAD_STORE_PATH_MAP_H
#define HEXAD_STORE_PATH_MAP_H

#include <stddef.h>

#include "base/error.h"

typedef struct path_map path_map;

/* Reads `from=to` from each text. NULL and an error (spec_invalid) when one is not that, when a `from` or
 * `to` is not absolute or a `from` is the root or stands twice. The caller releases with
 * path_map_free, which accepts NULL. */
path_map *path_map_read(const char *const *texts, size_t count, error *e);
void path_map_free(path_map *m);

/* The path here, to be freed; NULL when none applies or what comes out is what was given. `m` NULL
 * is an empty table. */
char *path_map_apply(const path_map *m, const char *path);

#endif
