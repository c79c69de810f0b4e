/* exr_reader: one channel of OpenEXR images, decoded in a process of its own (reader.h) by OpenEXR's C core.
 *
 * Requests come through the socket that is its descriptor 0 and 1: a request is one byte, EXR_READER_WINDOW,
 * EXR_READER_PIXELS or EXR_READER_LIST, with an open file's descriptor beside it (SCM_RIGHTS). The answer is a struct
 * exr_reader_answer, then `text_length` bytes of a message if `code` is an error, otherwise, for pixels, the channel's
 * values in the data window as floats (or, of a channel of whole numbers, as uint32_t), row by row. To EXR_READER_LIST
 * the text is a line for each channel of each part: part, storage, first and last column and row, channel, type, between
 * tabs. The machine's own byte order.
 */
#ifndef HEXAD_DENSE_EXR_READER_H
#define HEXAD_DENSE_EXR_READER_H

#include <stdint.h>

#define EXR_READER_COMMAND "read-exr"
#define EXR_READER_MAGIC 0x3172786564786568u /* "hexdxr1" */
#define EXR_READER_TEXT_MAX 768
#define EXR_READER_LIST_MAX 65536

enum { EXR_READER_WINDOW = 'w', EXR_READER_PIXELS = 'p', EXR_READER_LIST = 'l' };

typedef struct exr_reader_answer {
    uint64_t magic;
    uint32_t code; /* an error_code */
    uint32_t text_length;
    int32_t low[2], high[2]; /* the data window: first and last column, row */
    uint32_t whole;          /* pixels are whole numbers */
    float aspect;            /* the header's pixelAspectRatio */
} exr_reader_answer;

/* The program `read-exr NAMES MEMORY CPU_SECONDS`; NAMES has the channel and the part, each a line: '=' and
 * the name, or '*' for the only one. It ends when the socket is closed. */
int exr_reader_main(int argc, char **argv);

#endif
