/* zarr_reader: chunks of Zarr arrays, unpacked by zlib, blosc and zstd in a process of its own (reader.h). The only user of blosc and zstd.
 *
 * Requests are sent to the process over the socket that is its descriptor 0 and 1: a request is a struct zarr_request with an open file's descriptor
 * beside it. The answer is a struct zarr_answer, then `text_length` bytes of a message if `code` is an error, otherwise the bytes that
 * were requested.
 */
#ifndef HEXAD_DENSE_ZARR_READER_H
#define HEXAD_DENSE_ZARR_READER_H

#include <stdint.h>

#include "dense/zarr_metadata.h"

#define ZARR_READER_COMMAND "read-zarr"
#define ZARR_READER_MODULE "hexad-zarr.so"
#define ZARR_READER_MAGIC 0x317261727a786568u /* "hexzrar1" */
#define ZARR_READER_TEXT_MAX 512

typedef struct zarr_request {
    uint64_t offset, length; /* of the packed bytes in the file */
    uint64_t unpacked;       /* bytes that they have to be */
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
