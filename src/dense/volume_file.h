/* volume_file: a dense volume of any format by its path: one file, or a stack of images. The first bytes determine the format. */
#ifndef HEXAD_DENSE_VOLUME_FILE_H
#define HEXAD_DENSE_VOLUME_FILE_H

#include "dense/exr_stack.h"
#include "dense/slices.h"
#include "geometry/bbox.h"

typedef struct volume_file {
    int fd; /* open for reading; it, `path` and `files` stay the caller's and outlive the slices */
    const char *path;
    const char *program; /* that reads; NULL: this one */
    int64_t index;       /* of several volumes; -1: the only one */
    const slices_files *files;
    size_t memory_limit;               /* of the process that reads */
    const slices_directory *directory; /* in the place of `fd`: an OME-Zarr image; or NULL */
    bool has_level;
    int64_t level;          /* of its resolutions */
    const bbox *region;     /* in the world, in and near which samples of it are read; or NULL */
    int64_t most_chunks;    /* of it, that are read */
    const vec3 *voxel_size; /* in the place of the file's; or NULL */
} volume_file;

/* NRRD, NIfTI, MetaImage (raw_volume.h), TIFF (tiff_stack.h) or OME-Zarr (zarr_volume.h). One value at each sample. Errors: those of these modules. */
slices *volume_file_open(const volume_file *file, error *e);

/* The same of a file that may have several values at each sample. */
slices *volume_file_open_vectors(const volume_file *file, error *e);

/* A stack of OpenEXR or TIFF images. Errors: those of exr_stack.h and tiff_stack.h. */
slices *volume_file_open_stack(const exr_stack_params *params, error *e);

#endif
