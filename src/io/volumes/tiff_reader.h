// SPDX-License-Identifier: Apache-2.0
/* tiff_reader: reads pages of TIFF files with libtiff in a separate process (reader.h). The only user of
 * libtiff.
 *
 * Requests arrive through the socket that is descriptor 0 and 1 of the process. A request is a struct
 * tiff_request: TIFF_READER_OPEN, with the descriptor of an open file, or TIFF_READER_PAGE for the file that
 * was opened last. The answer is a struct tiff_answer. For TIFF_READER_PAGE, the numbers of the page follow
 * row by row.
 */
#ifndef HEXAD_IO_VOLUMES_TIFF_READER_H
#define HEXAD_IO_VOLUMES_TIFF_READER_H

#include <stdint.h>

#include "io/volumes/tiff_description.h"

#define TIFF_READER_COMMAND "read-tiff"
#define TIFF_READER_MODULE "hexad-tiff.so"

enum { TIFF_READER_OPEN = 'o', TIFF_READER_PAGE = 'p' };

typedef struct tiff_request {
    uint32_t what;
    uint32_t page; /* counted from 0, without pages of reduced resolution */
} tiff_request;

typedef struct tiff_answer {
    /* properties of the file, in the answers to both requests */
    int64_t width, height, pages;
    int64_t slices, channels, frames;             /* of a file with several pages */
    int64_t slice_step, channel_step, frame_step; /* in pages */
    uint32_t type;                                /* a number_type */
    double size[3];                               /* of a voxel; 0: unknown */
    double origin[3];                             /* the pixel at the origin of the world */
    char unit[TIFF_UNIT_SIZE];                    /* of size; "": unknown */
    uint32_t orientation, fill_order;             /* the tags Orientation and FillOrder, of all pages */
    uint32_t white_is_zero; /* 1: PhotometricInterpretation of all pages is WhiteIsZero */
    dense_warnings warnings;
} tiff_answer;

/* The program `read-tiff NAME MEMORY CPU_SECONDS`. It ends when the socket is closed. */
int tiff_reader_main(int argc, char **argv);

#endif
