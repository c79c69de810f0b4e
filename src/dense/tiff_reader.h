/* tiff_reader: pages of TIFF files, read by libtiff in a process of its own (reader.h). The only user of libtiff.
 *
 * Requests are sent to the process over the socket that is its descriptor 0 and 1. A request is a struct tiff_request: TIFF_READER_OPEN, with an open
 * file's descriptor beside it, or TIFF_READER_PAGE of the file that was opened last. The answer is a struct tiff_answer, then
 * `text_length` bytes of a message if `code` is an error. Otherwise, to TIFF_READER_PAGE, the numbers of the page follow, row by row, in
 * the machine's byte order.
 */
#ifndef HEXAD_DENSE_TIFF_READER_H
#define HEXAD_DENSE_TIFF_READER_H

#include <stdint.h>

#include "dense/tiff_description.h"

#define TIFF_READER_COMMAND "read-tiff"
#define TIFF_READER_MODULE "hexad-tiff.so"
#define TIFF_READER_MAGIC 0x3166697464786568u /* "hexdtif1" */
#define TIFF_READER_TEXT_MAX 768

enum { TIFF_READER_OPEN = 'o', TIFF_READER_PAGE = 'p' };

typedef struct tiff_request {
    uint32_t what;
    uint32_t page; /* counted from 0, pages of less resolution not among them */
} tiff_request;

typedef struct tiff_answer {
    uint64_t magic;
    uint32_t code; /* an error_code */
    uint32_t text_length;
    int64_t width, height, pages;                 /* of the file, to both requests */
    int64_t slices, channels, frames;             /* of a file of several pages */
    int64_t slice_step, channel_step, frame_step; /* in pages */
    uint32_t type;                                /* a header_type */
    double size[3];                               /* of a voxel; 0: unknown */
    double origin[3];                             /* the pixel at the world's origin */
    char unit[TIFF_UNIT_SIZE];                    /* of size; "": unknown */
    dense_warnings warnings;
} tiff_answer;

/* The program `read-tiff NAME MEMORY CPU_SECONDS`. It ends when the socket is closed. */
int tiff_reader_main(int argc, char **argv);

#endif
