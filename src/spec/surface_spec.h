// SPDX-License-Identifier: Apache-2.0
/* surface_spec: memory of a spec's surface, and its input files. Private to src/spec. */
#ifndef HEXAD_SPEC_SURFACE_SPEC_H
#define HEXAD_SPEC_SURFACE_SPEC_H

#include "spec/spec.h"

enum {
    SURFACE_SPEC_MOST_SLICES = 65536,       /* maximum number of slices of all stacks of a spec */
    SURFACE_SPEC_MOST_NAME_BYTES = 32 << 20 /* maximum bytes of the file names of all slices */
};

/* Parses `slices`: sets the count, the first number and the step. False: it is not FIRST-LAST or
 * FIRST-LASTxSTEP with FIRST < LAST. */
bool surface_spec_parse_slices(spec_exr *x, int *from, int *step);

/* Makes the numbers and the file names of the slices. False: `path` does not have exactly one place for a
 * number. */
bool surface_spec_name_slices(spec_exr *x, int from, int step);

/* The new path, which the caller frees, of a path. */
typedef char *surface_spec_renamer(const char *path, const void *by);

/* Replaces the paths of the surface and its parts, except those of stacks of images. */
void surface_spec_rename(spec_surface *s, surface_spec_renamer *rename, const void *by);

/* Finds file number *index of the surface and its parts. If there are fewer, *index decreases by their
 * number. */
bool surface_spec_input_at(const spec_surface *s, size_t *index, spec_input *out);

/* Frees everything the surface points to, including its parts. */
void surface_spec_free_parts(spec_surface *s);

#endif
