// SPDX-License-Identifier: Apache-2.0
/* label_source: opens a segmentation: a dense volume, a stack of images, or a grid of whole numbers in an
 * OpenVDB file. Outside of its active voxels such a grid has its background value.
 */
#ifndef HEXAD_JOB_SOURCE_LABEL_SOURCE_H
#define HEXAD_JOB_SOURCE_LABEL_SOURCE_H

#include "io/volumes/exr_stack.h"
#include "surface/labels/label_surface.h"

typedef struct label_source_request {
    int fd;                            /* the file; owned by the caller */
    label_surface_request how;         /* label_source_open sets `from` */
    const slices_files *files;         /* opens files that a header names */
    const exr_stack_params *stack;     /* read instead of the file; or NULL */
    const slices_directory *directory; /* read instead of the file; or NULL */
    int64_t most_chunks;               /* maximum number of chunks that are read */
    const vec3 *voxel_size;            /* overrides the size in the file; or NULL */
    slices *array;                     /* read instead of the file; owned by the caller; or NULL */
} label_source_request;

/* Errors: those of label_surface_open and of the readers; not_supported. Messages do not contain the path. */
label_surface *label_source_open(const label_source_request *request, error *e);

#endif
