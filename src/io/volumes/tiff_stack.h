// SPDX-License-Identifier: Apache-2.0
/* tiff_stack: pages of a TIFF file, or a stack of TIFF files, as a dense volume. libtiff runs in a separate
 * process (tiff_reader.h).
 *
 * Pixel (x, y) of slice k lies at voxel size (x, y, k), minus an origin that ImageJ may give. Voxel sizes
 * come from ImageJ's description, OME-XML or the resolution tags, in the unit of the file. A warning reports
 * missing values.
 */
#ifndef HEXAD_IO_VOLUMES_TIFF_STACK_H
#define HEXAD_IO_VOLUMES_TIFF_STACK_H

#include "io/volumes/exr_stack.h"
#include "io/volumes/slices.h"

/* Opens a file. `fd` remains the caller's and must outlive the slices; `program` as in exr_stack.h. `index`
 * of channel c at time t is c + channels t; -1: the only one. `voxel_size` replaces the size in the file;
 * NULL: it does not. Errors, without the path: input_damaged, input_unsupported, no_surface, grid_missing,
 * grid_ambiguous, limit_memory. */
slices *tiff_file_open(int fd, const char *program, int64_t index, size_t memory_limit,
                       const double voxel_size[3], error *e);

/* Opens files of one page each; every file is examined. Errors, with the paths: as of tiff_file_open,
 * input_missing, and those of the opener. */
slices *tiff_stack_open(const exr_stack_params *params, error *e);

#endif
