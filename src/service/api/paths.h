// SPDX-License-Identifier: Apache-2.0
/* paths: replaces the paths of clients in a job spec by paths of this machine (setting path_mappings).
 *
 * The mapped paths are stored with the job as a JSON array of objects: `pointer` into the spec, `asked` (the
 * path of the client) and `opened` (the path on this machine). The stored spec has the paths of this machine,
 * so that workers, the cache and copies of results do not need the mappings. No state; any thread.
 */
#ifndef HEXAD_SERVICE_API_PATHS_H
#define HEXAD_SERVICE_API_PATHS_H

#include "base/json/json.h"
#include "spec/spec.h"
#include "files/path_map.h"

/* Maps the paths in `document`, from which `s` was parsed. Returns the array, to be freed; NULL: no path was
 * mapped. `mappings` may be NULL. */
json *paths_map(const path_map *mappings, const spec *s, json *document);

/* Replaces the mapped paths in a document by the paths of the client. `paths` may be NULL. */
void paths_restore(const json *paths, json *document);

/* The path of the client at the pointer, borrowed from `paths`; NULL: it was not mapped. */
const char *paths_asked(const json *paths, const char *pointer);

#endif
