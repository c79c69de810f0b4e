// SPDX-License-Identifier: Apache-2.0
/* thumbnail: reads a PNG file of a preview and reduces it.
 *
 * A separate process (base/core/reader) decodes the file, because a worker that read untrusted inputs wrote
 * it. The program that is started has the command THUMBNAIL_COMMAND, which calls thumbnail_main. A build
 * without pictures has no_thumbnail.c instead of thumbnail.c.
 */
#ifndef HEXAD_IO_PICTURES_THUMBNAIL_H
#define HEXAD_IO_PICTURES_THUMBNAIL_H

#include <stdbool.h>
#include <stdint.h>

#include "base/core/error.h"

#define THUMBNAIL_COMMAND "read-picture"

enum { THUMBNAIL_SIDE = 128 }; /* maximum length of the longer side, pixels */

typedef struct thumbnail {
    int width, height;
    unsigned char rgb[3 * THUMBNAIL_SIDE * THUMBNAIL_SIDE]; /* rows from the top */
} thumbnail;

/* Deadline of a caller. The process is ended at `until_ms` (clock_monotonic_ms), and soon after `is_over`
 * returns true. */
typedef struct thumbnail_patience {
    int64_t until_ms;
    bool (*is_over)(void *context); /* NULL: never */
    void *context;
} thumbnail_patience;

/* Starts `program` (hexad-worker), which reads the file from its start. Pixels of the thumbnail are means of
 * the pixels that they cover. Errors: input_damaged (not a picture of picture_png_write), limit_time,
 * internal; not_supported in a build without pictures. */
bool thumbnail_read(const char *program, int fd, const thumbnail_patience *patience, thumbnail *out,
                    error *e);

/* Runs in the process; returns its exit status. */
int thumbnail_main(int argc, char **argv);

#endif
