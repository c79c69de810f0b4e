// SPDX-License-Identifier: Apache-2.0
/* volume_header: reads the header of an NRRD or NIfTI file with Teem and libnifti. The only user of these
 * libraries.
 *
 * They run in a separate process (reader.h) that receives only the open file. It opens no other file, even if
 * the header names one. It answers a volume_header. The text of the answer is the names of the data files,
 * one per line, as in the header.
 */
#ifndef HEXAD_IO_VOLUMES_VOLUME_HEADER_H
#define HEXAD_IO_VOLUMES_VOLUME_HEADER_H

#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#include "base/core/error.h"
#include "base/core/number.h"
#include "io/volumes/warnings.h"

#define VOLUME_HEADER_COMMAND "read-header"
#define VOLUME_HEADER_TEXT_MAX (4u << 20)

typedef enum volume_header_encoding {
    VOLUME_HEADER_RAW,
    VOLUME_HEADER_GZIP,
    VOLUME_HEADER_ASCII,
    VOLUME_HEADER_ENCODING_COUNT
} volume_header_encoding;

typedef struct volume_header {
    uint32_t type, encoding;
    uint32_t swapped;    /* numbers are in the other byte order */
    uint32_t line_skip;  /* number of lines before the data, counted from `offset` */
    uint32_t file_count; /* number of names in the text; 0: the data are in this file */
    int64_t offset;      /* start of the data in the first file, before unpacking */
    /* number of bytes to skip after lines and unpacking; -1 - n: the data end n bytes before the end of
     * the file */
    int64_t byte_skip;
    int64_t packed_bytes;      /* of the packed data, by the header; 0: unknown */
    int64_t size[3];           /* the first axis is the fastest */
    int64_t components;        /* number of values at each sample, stored consecutively; 0 counts as 1 */
    double vector_to_world[9]; /* rotation of vectors, row by row; all 0: none */
    int64_t volumes;           /* number of volumes of this size, stored consecutively; 0 counts as 1 */
    /* row-major, column vectors; index (0, 0, 0) is the position of the first sample */
    double index_to_world[16];
    double slope, intercept;    /* value = slope * number + intercept */
    char format[12], space[64]; /* names of the axes of the world, or "" */
    dense_warnings warnings;
} volume_header;

/* The program `read-header NAME MEMORY CPU_SECONDS`: reads the header of the file on descriptor 0, called
 * NAME, and writes the answer to descriptor 1. Returns the exit status; 0: the answer, which may be an error,
 * was written completely. */
int header_reader_main(int argc, char **argv);

/* The module that contains these functions, unless they are linked into the program. */
#define VOLUME_HEADER_MODULE "hexad-header.so"

/* Starts that process (of `program`, NULL: this one) and checks the answer. `fd` may be at any offset. *files
 * has the names of data files, one per line, or is NULL; the caller frees it. Errors, without the path:
 * input_damaged, input_unsupported, no_surface, internal. */
bool volume_header_read(int fd, const char *path, const char *program, volume_header *out, char **files,
                        error *e);

#endif
