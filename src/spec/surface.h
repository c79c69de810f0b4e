/* surface: what a spec's surface owns, and the files that it names. Private to src/spec. */
#ifndef HEXAD_SPEC_SURFACE_H
#define HEXAD_SPEC_SURFACE_H

#include "spec/spec.h"

enum { SURFACE_MOST_SLICES = 65536 };

/* From `slices` the count and the numbers; false when it is not two numbers, the second the larger, with or
 * without a step. */
bool surface_parse_slices(spec_exr *x);

/* From `path` and the numbers the files; false when it does not have one place for a number. */
bool surface_name_slices(spec_exr *x);

/* Puts the number of a frame into the paths of the surface and its parts. */
void surface_set_frame(spec_surface *s, int frame);

/* The *index-th file of the surface and its parts; counts *index down by those that it has before. */
bool surface_input_at(const spec_surface *s, size_t *index, spec_input *out);

/* What it points to, parts included. */
void surface_free_parts(spec_surface *s);

#endif
