// SPDX-License-Identifier: Apache-2.0
/* zarr_volume: one resolution of an OME-Zarr image, or a plain Zarr array, as a dense volume. Chunks are
 * unpacked in a separate process (zarr_reader.h).
 *
 * Slices follow the slowest of the three spatial axes; one layer of chunks is in memory. The axes x, y and z
 * of the file are those of the world. The position of a sample is scale times index plus translation. A
 * missing chunk has the fill value.
 */
#ifndef HEXAD_IO_VOLUMES_ZARR_VOLUME_H
#define HEXAD_IO_VOLUMES_ZARR_VOLUME_H

#include "io/volumes/slices.h"
#include "geometry/space/bbox.h"

typedef struct zarr_request_volume {
    const slices_directory *directory; /* owned by the caller; must outlive the slices */
    const char *program;               /* program that unpacks; NULL: this one */
    int64_t level;                     /* index of the resolution; 0: the finest */
    /* index of the volume along the other axes, the last one fastest; -1: the only one */
    int64_t index;
    const double *voxel_size; /* three, along x, y and z; replaces the size in the file; or NULL */
    const bbox *region;       /* in the world: only samples in and near it are read; or NULL */
    int64_t most_chunks;      /* maximum number of chunks to read */
    size_t memory_limit;
} zarr_request_volume;

/* Errors: those of zarr_metadata.h; limit_memory; input_unsupported (more than `most_chunks`). */
slices *zarr_volume_open(const zarr_request_volume *request, error *e);

#endif
