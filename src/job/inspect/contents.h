// SPDX-License-Identifier: Apache-2.0
/* contents: lists the contents of the files of one format, and suggests a spec for each surface in them. */
#ifndef HEXAD_JOB_INSPECT_CONTENTS_H
#define HEXAD_JOB_INSPECT_CONTENTS_H

#include "base/core/error.h"
#include "base/json/json.h"
#include "job/phases/run_options.h"

typedef struct contents_input {
    int fd;           /* open for reading; a directory: for store_tree_new */
    const char *path; /* the path for suggested specs */
    const run_options *options;
} contents_input;

/* Adds the members of the format to the inspection, and appends to its array `suggestions`. Errors: those of
 * a job that reads the file. */
typedef bool contents_reader(const contents_input *in, json *inspection, error *e);

contents_reader contents_read_vdb, contents_read_dense, contents_read_exr, contents_read_tiff,
    contents_read_zarr, contents_read_mesh;

#endif
