/* paths: the names that a job uses for files, and those that they have here.
 *
 * What was mapped is kept with the job as a JSON array of objects: `pointer` into the spec, `asked` and
 * `opened`. The stored spec has what is opened, so that workers, the cache and copies of results need to know
 * nothing of it.
 */
#ifndef HEXAD_API_PATHS_H
#define HEXAD_API_PATHS_H

#include "json/json.h"
#include "spec/spec.h"
#include "store/path_map.h"

/* Maps the paths of a document that `s` was parsed from, and returns what was, or NULL: nothing. */
json *paths_map(const path_map *mappings, const spec *s, json *document);

/* Puts back what was asked for. */
void paths_restore(const json *paths, json *document);

/* The name that was asked for at the pointer; NULL: the one that is opened. */
const char *paths_asked(const json *paths, const char *pointer);

#endif
