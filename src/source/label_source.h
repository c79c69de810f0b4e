/* label_source: opens a segmentation: a dense volume, a stack of images, or a grid of whole numbers in an OpenVDB file, which goes on with its
 * background beyond its active voxels. */
#ifndef HEXAD_SOURCE_LABEL_SOURCE_H
#define HEXAD_SOURCE_LABEL_SOURCE_H

#include "dense/exr_stack.h"
#include "labels/label_surface.h"

typedef struct label_source_request {
    int fd;                            /* the file, the caller's */
    label_surface_request how;         /* its `from` is found here */
    const slices_files *files;         /* that a header names */
    const exr_stack_params *stack;     /* in place of the file; or NULL */
    const slices_directory *directory; /* in place of the file; or NULL */
    int64_t most_chunks;               /* of it, that are read */
    const vec3 *voxel_size;            /* in the place of the file's; or NULL */
} label_source_request;

/* Errors: those of label_surface_open, of the readers, and not_supported; without the path. */
label_surface *label_source_open(const label_source_request *request, error *e);

#endif
