/* tiff_stack: pages of a TIFF file, or TIFF files one upon the other, as a dense volume. libtiff runs in a process of its own
 * (tiff_reader.h).
 *
 * Pixel (x, y) of slice k lies at voxel size (x, y, k), less an origin that ImageJ may give. Voxel sizes come from ImageJ's
 * description, OME-XML or the tags of the resolution, in the unit of the file; a warning reports what is missing.
 */
#ifndef HEXAD_DENSE_TIFF_STACK_H
#define HEXAD_DENSE_TIFF_STACK_H

#include "dense/exr_stack.h"
#include "dense/slices.h"

/* Whether an open file begins as TIFF files do. */
bool tiff_stack_is(int fd);

/* `fd` stays the caller's and outlives the slices; `program` as in exr_stack.h. `index` is of channel c at time t, c + channels t; -1: the
 * only one. `voxel_size`: NULL, or in the place of the file's. Errors: input_damaged, input_unsupported, no_surface, grid_missing,
 * grid_ambiguous, limit_memory; without the path. */
slices *tiff_file_open(int fd, const char *program, int64_t index, size_t memory_limit,
                       const double voxel_size[3], error *e);

/* Files of one page each. Every one is looked at. Errors: also input_missing and those of the opener; with the paths. */
slices *tiff_stack_open(const exr_stack_params *params, error *e);

#endif
