// SPDX-License-Identifier: Apache-2.0
/* zarr_reader: unpacks chunks of Zarr arrays with zlib, blosc and zstd in a separate process (reader.h). The
 * only user of blosc and zstd.
 *
 * Requests arrive through the socket that is descriptor 0 and 1 of the process. A request is a struct
 * zarr_request with the descriptor of an open file. The answer has no struct: the requested bytes follow its
 * head.
 */
#ifndef HEXAD_IO_VOLUMES_ZARR_READER_H
#define HEXAD_IO_VOLUMES_ZARR_READER_H

#include <stdint.h>

#include "io/volumes/zarr_metadata.h"

#define ZARR_READER_COMMAND "read-zarr"
#define ZARR_READER_MODULE "hexad-zarr.so"

typedef struct zarr_request {
    uint64_t offset, length; /* of the packed bytes in the file */
    uint64_t unpacked;       /* required number of unpacked bytes */
    zarr_packing packing;
} zarr_request;

/* The program `read-zarr NAME MEMORY CPU_SECONDS`. It ends when the socket is closed. */
int zarr_reader_main(int argc, char **argv);

#endif
