/* header: reads the header of an NRRD or NIfTI file with Teem and libnifti. The only users of these libraries.
 *
 * They run in a process of their own (reader.h) that is given the open file and nothing else: no other file
 * is opened there, whatever the header names. It writes a struct header and then `text_length` bytes: a
 * message when `code` is an error, otherwise the names of the files that hold the data, one a line, as the
 * header has them. The machine's own byte order, as both ends are one machine.
 */
#ifndef HEXAD_DENSE_HEADER_H
#define HEXAD_DENSE_HEADER_H

#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#include "base/error.h"
#include "dense/warnings.h"

#define HEADER_COMMAND "read-header"
#define HEADER_MAGIC 0x3172646864786568u /* "hexdhdr1" */
#define HEADER_TEXT_MAX (4u << 20)

typedef enum header_type {
    HEADER_INT8,
    HEADER_UINT8,
    HEADER_INT16,
    HEADER_UINT16,
    HEADER_INT32,
    HEADER_UINT32,
    HEADER_INT64,
    HEADER_UINT64,
    HEADER_FLOAT,
    HEADER_DOUBLE,
    HEADER_TYPE_COUNT
} header_type;

typedef enum header_encoding { HEADER_RAW, HEADER_GZIP, HEADER_ASCII, HEADER_ENCODING_COUNT } header_encoding;

typedef struct header {
    uint64_t magic;
    uint32_t code; /* an error_code; ERROR_NONE: what follows is set */
    uint32_t text_length;
    uint32_t type, encoding;
    uint32_t swapped;    /* numbers are in the other byte order */
    uint32_t line_skip;  /* lines before the data, where they begin in their file */
    uint32_t file_count; /* names in the text; 0: the data are in this file */
    int64_t offset;      /* where they begin in their first file, before unpacking */
    int64_t
        byte_skip; /* bytes before them after lines and unpacking; -1 - n: they end n bytes before the end */
    int64_t packed_bytes;       /* of the packed data, by the header; 0: unknown */
    int64_t size[3];            /* the first axis is the fastest */
    int64_t components;         /* values at each sample, next to each other; 0 counts as 1 */
    double vector_to_world[9];  /* what those of a vector are turned by, row by row; all 0: by nothing */
    int64_t volumes;            /* of that size, one after the other; 0 counts as 1 */
    double index_to_world[16];  /* row-major, column vectors; index (0, 0, 0) is the first sample's place */
    double slope, intercept;    /* value = slope * number + intercept */
    char format[12], space[64]; /* "NRRD", "NIfTI" or "MetaImage"; the world's axes by name, or "" */
    dense_warnings warnings;
} header;

/* The program `read-header NAME MEMORY CPU_SECONDS`: reads the header of the file on descriptor 0, called
 * NAME, writes to descriptor 1. Returns the exit status, 0 when the answer, good or bad, was written whole.
 */
int header_reader_main(int argc, char **argv);

/* The module that contains it, unless it is linked in. */
#define HEADER_MODULE "hexad-header.so"

/* `fd` may be at any offset. Starts that process (of `program`, NULL: this one) and checks the answer. *files, when
 * there are any, is to be freed: one name a line. Errors: input_damaged, input_unsupported, no_surface, internal;
 * without the path. */
bool header_read(int fd, const char *path, const char *program, header *out, char **files, error *e);

#endif
