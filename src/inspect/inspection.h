/* inspection: describes the contents of a file, and suggests specs that sample it.
 *
 * Readers are those of jobs: their processes, their limits, their errors. */
#ifndef HEXAD_INSPECT_INSPECTION_H
#define HEXAD_INSPECT_INSPECTION_H

#include <stdio.h>

#include "base/error.h"
#include "json/json.h"
#include "run/run_options.h"

/* An object (doc/inspect.md), to be freed; `path` is opened below options->roots. NULL and an error when the file cannot be
 * read: those of a job that names it. */
json *inspection_make(const char *path, const run_options *options, error *e);

/* The same for people. */
void inspection_print(const json *inspection, FILE *out);

/* The first suggestion that can be sampled, preferably one whose surface was measured; NULL: there is none. It belongs
 * to the inspection. */
const json *inspection_spec(const json *inspection);

#endif
