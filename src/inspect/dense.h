/* dense: what the inspection of all dense volumes has in common. */
#ifndef HEXAD_INSPECT_DENSE_H
#define HEXAD_INSPECT_DENSE_H

#include "dense/slices.h"
#include "inspect/contents.h"

/* Opens a file beside an input; `context` is its contents_input. */
int dense_open_beside(void *context, const char *path, error *e);

/* Adds size, space, frame and values of a volume to `o`, and suggestions: the surface `kind` (volume or exr) of the members
 * `file`, with isovalues, and `labels` of a segmentation, the first where there are more than two. Reads the volume once. */
bool dense_describe(const contents_input *in, slices *s, const char *kind, const json *file, json *o,
                    json *suggestions, error *e);

/* Adds `volume`, with the members of dense_describe, and the format. `file`: the members of surface.volume that name the volume; `index` is
 * added to them. */
bool dense_describe_volume(const contents_input *in, slices *s, json *file, json *inspection, error *e);

/* The file as a dense volume, the first of several; NULL: an error without the path. */
slices *dense_open(const contents_input *in, const slices_files *files, error *e);

#endif
