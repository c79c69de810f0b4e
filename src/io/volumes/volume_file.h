// SPDX-License-Identifier: Apache-2.0
/* volume_file: opens a dense volume of any format: one file, or a stack of images. The first bytes determine
 * the format.
 */
#ifndef HEXAD_IO_VOLUMES_VOLUME_FILE_H
#define HEXAD_IO_VOLUMES_VOLUME_FILE_H

#include "base/core/file_format.h"
#include "io/volumes/exr_stack.h"
#include "io/volumes/slices.h"
#include "geometry/space/bbox.h"

typedef struct volume_file {
    int fd; /* open for reading; `fd`, `path` and `files` remain the caller's and must outlive the slices */
    const char *path;
    const char *program; /* program that reads; NULL: this one */
    int64_t index;       /* index of the volume; -1: the only one */
    const slices_files *files;
    size_t memory_limit;               /* memory limit of the reading process */
    const slices_directory *directory; /* an OME-Zarr image, instead of `fd`; or NULL */
    bool has_level;
    int64_t level;          /* index of its resolution */
    const bbox *region;     /* world units: only samples in and near this box are read; or NULL */
    int64_t most_chunks;    /* maximum number of its chunks that are read */
    const vec3 *voxel_size; /* replaces the size in the file; or NULL */
} volume_file;

/* Whether this module reads volumes, or stacks of images, of the format. */
bool volume_file_reads(file_format format);

/* Opens NRRD, NIfTI, MetaImage (raw_volume.h), TIFF (tiff_stack.h) or OME-Zarr (zarr_volume.h) with one value
 * per sample. Errors: those of these modules. */
slices *volume_file_open(const volume_file *file, error *e);

/* As volume_file_open, for a file that may have several values per sample. */
slices *volume_file_open_vectors(const volume_file *file, error *e);

/* A stack of OpenEXR or TIFF images. Errors: those of exr_stack.h and tiff_stack.h. */
slices *volume_file_open_stack(const exr_stack_params *params, error *e);

#endif
