// SPDX-License-Identifier: Apache-2.0
/* dense_inspection: the inspection of dense volumes, for all their formats. */
#ifndef HEXAD_JOB_INSPECT_DENSE_INSPECTION_H
#define HEXAD_JOB_INSPECT_DENSE_INSPECTION_H

#include "io/volumes/slices.h"
#include "job/inspect/contents.h"

/* Opens a file that a header names. `context`: the contents_input. */
int dense_inspection_open_beside(void *context, const char *path, error *e);

/* Adds size, space, frame and values of a volume to `o`. Suggests surfaces of the given `kind` (volume or
 * exr) with the members of `file`, with isovalues, and `labels` for a segmentation, which come first if there
 * are more than two labels. Reads the volume once. */
bool dense_inspection_describe(const contents_input *in, slices *s, const char *kind, const json *file,
                               json *o, json *suggestions, error *e);

/* Adds the format and `volume`, with the members of dense_inspection_describe. `file`: the members of
 * surface.volume that name the volume; `index` is added to them. */
bool dense_inspection_describe_volume(const contents_input *in, slices *s, json *file, json *inspection,
                                      error *e);

/* Opens the file as a dense volume, the first one of several. NULL: an error; its message does not contain
 * the path. */
slices *dense_inspection_open(const contents_input *in, const slices_files *files, error *e);

#endif
