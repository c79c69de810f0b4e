// SPDX-License-Identifier: Apache-2.0
/* inspection: describes the contents of a file, and suggests specs that sample it.
 *
 * Files are read as in jobs: in the same processes, with the same limits and errors.
 */
#ifndef HEXAD_JOB_INSPECT_INSPECTION_H
#define HEXAD_JOB_INSPECT_INSPECTION_H

#include <stdio.h>

#include "base/core/error.h"
#include "base/json/json.h"
#include "job/phases/run_options.h"

/* Returns the inspection, an object (doc/inspect.md) that the caller frees. `path` is opened below
 * options->roots. NULL: the file cannot be read; the errors are those of a job that reads it. */
json *inspection_make(const char *path, const run_options *options, error *e);

/* Prints the inspection as text for readers. */
void inspection_print(const json *inspection, FILE *out);

/* Returns the first suggestion that can be sampled, preferably one whose surface was measured; NULL: none. It
 * is owned by the inspection. */
const json *inspection_spec(const json *inspection);

#endif
