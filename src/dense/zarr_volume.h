/* zarr_volume: one resolution of an OME-Zarr image, or a plain Zarr array, as a dense volume. Chunks are unpacked in a process of their
 * own (zarr_reader.h).
 *
 * Slices follow one another along the slowest of the three spatial axes; a layer of chunks is held. Axes x, y and z of the file are
 * those of the world; a sample lies at scale times index plus translation. A chunk without a file has the fill value.
 */
#ifndef HEXAD_DENSE_ZARR_VOLUME_H
#define HEXAD_DENSE_ZARR_VOLUME_H

#include "dense/slices.h"
#include "geometry/bbox.h"

typedef struct zarr_request_volume {
    const slices_directory *directory; /* the caller's, who keeps it as long as the slices live */
    const char *program;               /* that unpacks; NULL: this one */
    int64_t level;                     /* the resolution, 0 the finest */
    int64_t index;            /* of the volume among the other axes, the last the fastest; -1: the only one */
    const double *voxel_size; /* three, in the place of the file's along x, y and z; or NULL */
    const bbox *region;       /* in the world: only samples in and near it are read; or NULL */
    int64_t most_chunks;      /* that may be read */
    size_t memory_limit;
} zarr_request_volume;

/* Errors: those of zarr_metadata.h; limit_memory; input_unsupported for more chunks. */
slices *zarr_volume_open(const zarr_request_volume *request, error *e);

#endif
