/* path_map: translates paths of other machines into paths of this host.
 *
 * A table of pairs of prefixes, `from` and `to`. A path is translated when its first components equal a `from`;
 * the longest `from` wins and is applied once. In Windows paths, which begin with a drive (`Z:`) or a share (`\\` or
 * `//`), `/` and `\` are equal, and so are upper and lower case of ASCII letters. Relative paths and names of
 * uploaded files (store/inputs.h) are never translated. Only the text is compared; no file is opened, and
 * the code that opens the path checks for `..`. Immutable once read; any thread may use it.
 */
#ifndef HEXAD_STORE_PATH_MAP_H
#define HEXAD_STORE_PATH_MAP_H

#include <stddef.h>

#include "base/error.h"

typedef struct path_map path_map;

/* Reads `from=to` from each text. Returns NULL and spec_invalid if a text has another form, a `from` or `to` is not
 * absolute, or a `from` is the root or appears twice. The caller releases with path_map_free, which
 * accepts NULL. */
path_map *path_map_read(const char *const *texts, size_t count, error *e);
void path_map_free(path_map *m);

/* The translated path, to be freed by the caller; NULL if no prefix applies or the path does not change. `m` NULL
 * is an empty table. */
char *path_map_apply(const path_map *m, const char *path);

#endif
