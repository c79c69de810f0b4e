// SPDX-License-Identifier: Apache-2.0
/* exr_reader: decodes one channel of OpenEXR images in a separate process (reader.h) with OpenEXR's C core.
 *
 * Requests arrive through the socket that is descriptor 0 and 1 of the process. A request is one byte,
 * EXR_READER_WINDOW, EXR_READER_PIXELS or EXR_READER_LIST, with the descriptor of an open file (SCM_RIGHTS).
 * The answer is a struct exr_reader_answer. For pixels, the values of the channel in the data window follow
 * row by row, as floats or, for a channel of whole numbers, as uint32_t. For EXR_READER_LIST the text has a
 * line for each channel of each part: part, storage, first and last column and row, channel, type, separated
 * by tabs.
 */
#ifndef HEXAD_IO_VOLUMES_EXR_READER_H
#define HEXAD_IO_VOLUMES_EXR_READER_H

#include <stdint.h>

#define EXR_READER_COMMAND "read-exr"
#define EXR_READER_LIST_MAX 65536

enum { EXR_READER_WINDOW = 'w', EXR_READER_PIXELS = 'p', EXR_READER_LIST = 'l' };

typedef struct exr_reader_answer {
    int32_t low[2], high[2]; /* the data window: first and last column, row */
    uint32_t whole;          /* pixels are whole numbers */
    float aspect;            /* the header's pixelAspectRatio */
} exr_reader_answer;

/* The program `read-exr NAMES MEMORY CPU_SECONDS`. NAMES has a line for the channel and one for the part: '='
 * and the name, or '*' for the only one. The program ends when the socket is closed. */
int exr_reader_main(int argc, char **argv);

#endif
