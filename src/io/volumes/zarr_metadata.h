// SPDX-License-Identifier: Apache-2.0
/* zarr_metadata: parses the JSON files of an OME-Zarr 0.4 or 0.5 directory, or of a plain Zarr array, for one
 * resolution. One thread.
 *
 * Files are read by a function of the caller, which opens them below the directory.
 */
#ifndef HEXAD_IO_VOLUMES_ZARR_METADATA_H
#define HEXAD_IO_VOLUMES_ZARR_METADATA_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "io/volumes/volume_header.h"
#include "io/volumes/slices.h"

enum { ZARR_AXES_MOST = 8, ZARR_CODECS_MOST = 6, ZARR_PATH_SIZE = 1024 };

/* The codecs of chunks. */
typedef enum zarr_codec { ZARR_ZLIB, ZARR_BLOSC, ZARR_ZSTD, ZARR_CRC32C, ZARR_CODECS } zarr_codec;

typedef struct zarr_packing {
    uint32_t count;
    uint32_t codec[ZARR_CODECS_MOST]; /* a zarr_codec, in the order in which they were applied */
} zarr_packing;

typedef struct zarr_metadata {
    char path[ZARR_PATH_SIZE]; /* of the array below the directory: "", or with a final slash */
    int axes;
    int64_t shape[ZARR_AXES_MOST],
        chunk[ZARR_AXES_MOST];     /* the last axis is the fastest; chunk: the unit of compression */
    int64_t shard[ZARR_AXES_MOST]; /* the contents of a file: chunks, or `chunk` itself */
    bool is_sharded, is_index_first, has_index_checksum;
    int stored[ZARR_AXES_MOST]; /* order of the axes in a chunk, slowest first */
    number_type type;
    bool is_swapped; /* numbers have the opposite byte order */
    bool has_fill;   /* false: missing chunks have no defined values */
    double fill;     /* value of missing chunks */
    zarr_packing packing;
    char separator;    /* of numbers in names of chunks */
    bool has_c_prefix; /* names begin with c */
    bool is_ome;
    int space[3];                    /* the spatial axes, slowest first */
    int row[3];                      /* index of the world coordinate of each spatial axis */
    double scale[3], translation[3]; /* of each spatial axis */
    char unit[40];
    dense_warnings warnings;
} zarr_metadata;

/* `level` is the index of the resolution. Errors: input_damaged, input_unsupported (with the name of the
 * unsupported feature), grid_missing, grid_ambiguous, no_surface; those of the opener. */
bool zarr_metadata_read(const slices_directory *directory, int64_t level, zarr_metadata *out, error *e);

#endif
