/* zarr_reader: unpacks chunks of Zarr arrays with zlib, blosc and zstd in a separate process (reader.h). The only
 * user of blosc and zstd.
 *
 * Requests arrive through the socket that is descriptor 0 and 1 of the process. A request is a struct zarr_request
 * with the descriptor of an open file. The answer is a struct zarr_answer. If `code` is an error, `text_length`
 * bytes of a message follow, otherwise the requested bytes.
 */
#ifndef HEXAD_IO_VOLUMES_ZARR_READER_H
#define HEXAD_IO_VOLUMES_ZARR_READER_H

#include <stdint.h>

#include "io/volumes/zarr_metadata.h"

#define ZARR_READER_COMMAND "read-zarr"
#define ZARR_READER_MODULE "hexad-zarr.so"
#define ZARR_READER_MAGIC 0x317261727a786568u /* "hexzrar1" */
#define ZARR_READER_TEXT_MAX 512

typedef struct zarr_request {
    uint64_t offset, length; /* of the packed bytes in the file */
    uint64_t unpacked;       /* required number of unpacked bytes */
    zarr_packing packing;
} zarr_request;

typedef struct zarr_answer {
    uint64_t magic;
    uint32_t code; /* an error_code */
    uint32_t text_length;
} zarr_answer;

/* The program `read-zarr NAME MEMORY CPU_SECONDS`. It ends when the socket is closed. */
int zarr_reader_main(int argc, char **argv);

#endif
