// SPDX-License-Identifier: Apache-2.0
/* image_reader: decodes PNG and JPEG images in a separate process (reader.h), one process for each image.
 *
 * A request arrives through the socket that is descriptor 0 and 1 of the process: an image_request with the
 * descriptor of an open file, or without one; then `bytes` bytes of the image follow in pieces of
 * IMAGE_READER_PIECE, the last of which may be shorter. The answer is an image_facts. The pixels follow it, as
 * image_decode returns them, if they are requested and the format is read.
 */
#ifndef HEXAD_IO_IMAGES_IMAGE_READER_H
#define HEXAD_IO_IMAGES_IMAGE_READER_H

#include <stdint.h>

#define IMAGE_READER_COMMAND "read-image"
#define IMAGE_READER_MODULE "hexad-image.so"

enum { IMAGE_READER_PIECE = 65536 };

typedef struct image_request {
    uint64_t bytes;  /* of an image without a file of its own */
    uint64_t pixels; /* as image_limits */
    uint64_t scans;
    uint64_t returns_pixels;
} image_request;

/* The program `read-image NAME MEMORY CPU_SECONDS`. It ends when the socket is closed. */
int image_reader_main(int argc, char **argv);

#endif
