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

/* The member of a surface that names the file, by its name and first bytes: "mesh", "vdb", or NULL for other
 * files. See sample_spec_needs_inspection. */
const char *inspection_member(const char *path, const run_options *options);

/* Prints the inspection as text for readers. */
void inspection_print(const json *inspection, FILE *out);

#endif
