// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/volume_file.h"

#include <unistd.h>

#include "io/volumes/raw_volume.h"
#include "io/volumes/tiff_stack.h"
#include "io/volumes/zarr_volume.h"

/* Opens a volume. `vectors`: several values per sample are kept. */
typedef slices *opener(const volume_file *f, bool vectors, error *e);

typedef struct volume_reader {
    opener *open;
    slices *(*open_stack)(const exr_stack_params *params, error *e);
} volume_reader;

static opener open_zarr, open_tiff, open_raw;

static const volume_reader readers[FILE_FORMATS] = {
    [FILE_FORMAT_NRRD] = {.open = open_raw},
    [FILE_FORMAT_NIFTI] = {.open = open_raw},
    [FILE_FORMAT_META_IMAGE] = {.open = open_raw},
    [FILE_FORMAT_TIFF] = {.open = open_tiff, .open_stack = tiff_stack_open},
    [FILE_FORMAT_OME_ZARR] = {.open = open_zarr},
    [FILE_FORMAT_EXR] = {.open_stack = exr_stack_open}};

static slices *open_zarr(const volume_file *f, bool vectors, error *e)
{
    (void)vectors;
    const double size[3] = {f->voxel_size ? f->voxel_size->x : 0, f->voxel_size ? f->voxel_size->y : 0,
                            f->voxel_size ? f->voxel_size->z : 0};
    const zarr_request_volume request = {.directory = f->directory,
                                         .program = f->program,
                                         .level = f->level,
                                         .index = f->index,
                                         .voxel_size = f->voxel_size ? size : NULL,
                                         .region = f->region,
                                         .most_chunks = f->most_chunks,
                                         .memory_limit = f->memory_limit};
    return zarr_volume_open(&request, e);
}

static slices *open_tiff(const volume_file *f, bool vectors, error *e)
{
    (void)vectors;
    const double size[3] = {f->voxel_size ? f->voxel_size->x : 0, f->voxel_size ? f->voxel_size->y : 0,
                            f->voxel_size ? f->voxel_size->z : 0};
    return tiff_file_open(f->fd, f->program, f->index, f->memory_limit, f->voxel_size ? size : NULL, e);
}

static slices *open_raw(const volume_file *f, bool vectors, error *e)
{
    slices *s = vectors ? raw_vectors_open(f->fd, f->path, f->program, f->index, f->files, e)
                        : raw_volume_open(f->fd, f->path, f->program, f->index, f->files, e);
    if (s && f->voxel_size)
        slices_set_voxel_size(s, (const double[]){f->voxel_size->x, f->voxel_size->y, f->voxel_size->z});
    return s;
}

bool volume_file_reads(file_format format)
{
    return readers[format].open || readers[format].open_stack;
}

/* Opens a file of unknown format: the header reader names the formats that it recognises in its message. */
static slices *open_any(const volume_file *f, bool vectors, error *e)
{
    if (f->directory) return open_zarr(f, vectors, e);
    if (f->has_level) {
        error_set(
            e, ERROR_NOT_SUPPORTED,
            "the file has one resolution, and level is for the directory of an OME-Zarr image: remove level");
        return NULL;
    }
    opener *open = readers[file_format_of_file(f->fd, "")].open;
    return open ? open(f, vectors, e) : open_raw(f, vectors, e);
}

slices *volume_file_open(const volume_file *file, error *e)
{
    return open_any(file, false, e);
}

slices *volume_file_open_vectors(const volume_file *file, error *e)
{
    return open_any(file, true, e);
}

/* The first existing image determines the format. */
slices *volume_file_open_stack(const exr_stack_params *params, error *e)
{
    for (size_t k = 0; k < params->count; k++) {
        const int fd = params->files->open(params->files->context, params->paths[k], NULL);
        if (fd < 0) continue;
        const volume_reader *r = &readers[file_format_of_file(fd, "")];
        close(fd);
        return r->open_stack ? r->open_stack(params, e) : exr_stack_open(params, e);
    }
    return exr_stack_open(params, e);
}
