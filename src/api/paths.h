/* paths: translates the paths in a job spec to those of this machine (setting path_mappings).
 *
 * The mapped paths are stored with the job as a JSON array of objects: `pointer` into the spec, `asked` (the
 * client's path) and `opened` (the local one). The stored spec has the local paths, so that workers, the
 * cache and copies of results need not know the mappings.
 */
#ifndef HEXAD_API_PATHS_H
#define HEXAD_API_PATHS_H

#include "json/json.h"
#include "spec/spec.h"
#include "store/path_map.h"

/* Maps the paths in the document that `s` was parsed from; returns the array, or NULL when none was mapped. */
json *paths_map(const path_map *mappings, const spec *s, json *document);

/* Puts the client's paths back into a document. */
void paths_restore(const json *paths, json *document);

/* The client's path at the pointer; NULL: it was not mapped. */
const char *paths_asked(const json *paths, const char *pointer);

#endif
