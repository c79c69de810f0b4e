// SPDX-License-Identifier: Apache-2.0
/* image_file: a PNG or JPEG image, from an open file or from memory, decoded by a process of its own (see
 * image_reader). */
#ifndef HEXAD_IO_IMAGES_IMAGE_FILE_H
#define HEXAD_IO_IMAGES_IMAGE_FILE_H

#include "base/core/error.h"
#include "io/images/image_decode.h"

typedef struct image_file {
    int fd;           /* open for reading; -1: the image is in memory. It is not closed. */
    const void *data; /* the image in memory, of `size` bytes */
    size_t size;
    const char *name;    /* its ending identifies formats without a signature */
    const char *program; /* whose command `read-image` calls image_reader_main; NULL: this program */
    image_limits limits; /* memory: for the reading process, and again for the pixels */
} image_file;

/* Checks that the whole image can be decoded. *facts may name a format that is not read. Errors: those of
 * image_decode; internal. They do not name the file. */
bool image_file_check(const image_file *file, image_facts *facts, error *e);

/* Decodes the image; free(*pixels) after success. *pixels is NULL if *facts names a format that is not read. */
bool image_file_read(const image_file *file, image_facts *facts, void **pixels, error *e);

#endif
