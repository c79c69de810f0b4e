/* thumbnail: a PNG file of a preview, made small enough for a contact sheet.
 *
 * A process of its own (base/reader) decodes the file, since a worker that read untrusted inputs wrote it. The program that
 * is started has the command THUMBNAIL_COMMAND, which calls thumbnail_main. A build without pictures has no_thumbnail.c
 * instead of thumbnail.c.
 */
#ifndef HEXAD_FORMATS_THUMBNAIL_H
#define HEXAD_FORMATS_THUMBNAIL_H

#include <stdbool.h>
#include <stdint.h>

#include "base/error.h"

#define THUMBNAIL_COMMAND "read-picture"

enum { THUMBNAIL_SIDE = 128 }; /* pixels of the longer side, at most */

typedef struct thumbnail {
    int width, height;
    unsigned char rgb[3 * THUMBNAIL_SIDE * THUMBNAIL_SIDE]; /* rows from the top */
} thumbnail;

/* How long a caller waits. The process is ended at `until_ms` (clock_monotonic_ms), and soon after `is_over` returns true. */
typedef struct thumbnail_patience {
    int64_t until_ms;
    bool (*is_over)(void *context); /* NULL: never */
    void *context;
} thumbnail_patience;

/* Has `program` (hexad-worker) read the file from its beginning. Pixels of the thumbnail are means of those that it covers.
 * Errors: input_damaged for a file that is no picture of picture_png_write, limit_time, internal;
 * not_supported in a build without pictures. */
bool thumbnail_read(const char *program, int fd, const thumbnail_patience *patience, thumbnail *out,
                    error *e);

/* In the process: the exit status. */
int thumbnail_main(int argc, char **argv);

#endif
