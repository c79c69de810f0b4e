#include "io/volumes/volume_file.h"

#include <unistd.h>

#include "io/volumes/raw_volume.h"
#include "io/volumes/tiff_stack.h"
#include "io/volumes/zarr_volume.h"

static slices *open_any(const volume_file *f, bool vectors, error *e)
{
    const double size[3] = {f->voxel_size ? f->voxel_size->x : 0, f->voxel_size ? f->voxel_size->y : 0,
                            f->voxel_size ? f->voxel_size->z : 0};
    if (f->directory) {
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
    if (f->has_level) {
        error_set(
            e, ERROR_NOT_SUPPORTED,
            "the file has one resolution, and level is for the directory of an OME-Zarr image: remove level");
        return NULL;
    }
    if (tiff_stack_is(f->fd))
        return tiff_file_open(f->fd, f->program, f->index, f->memory_limit, f->voxel_size ? size : NULL, e);
    slices *s = vectors ? raw_vectors_open(f->fd, f->path, f->program, f->index, f->files, e)
                        : raw_volume_open(f->fd, f->path, f->program, f->index, f->files, e);
    if (s && f->voxel_size) slices_set_voxel_size(s, size);
    return s;
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
        const bool is_tiff = tiff_stack_is(fd);
        close(fd);
        return is_tiff ? tiff_stack_open(params, e) : exr_stack_open(params, e);
    }
    return exr_stack_open(params, e);
}
