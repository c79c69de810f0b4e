// SPDX-License-Identifier: Apache-2.0
/* image_decode: decodes PNG and JPEG images in memory. The only user of libjpeg, and with io/pictures of libpng.
 *
 * Runs in the process that reads (image_reader.h). One image at a time: the libraries' errors jump. Colours are
 * those of the file: its gamma, its colour profile and the orientation in its EXIF data are not applied.
 */
#ifndef HEXAD_IO_IMAGES_IMAGE_DECODE_H
#define HEXAD_IO_IMAGES_IMAGE_DECODE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"

typedef struct image_limits {
    uint64_t pixels; /* maximum of width times height */
    uint64_t scans;  /* maximum number of scans of a progressive JPEG image */
    size_t memory;   /* bytes, of the pixels */
} image_limits;

enum { IMAGE_FORMAT_SIZE = 16 };

/* What is known of an image. */
typedef struct image_facts {
    uint32_t width, height;
    uint32_t bits; /* of a component: 8 or 16 */
    uint32_t has_profile, has_exif;
    char unread
        [IMAGE_FORMAT_SIZE]; /* name of a format that is not read: then the other members are 0; or "" */
} image_facts;

/* Returns the pixels row by row from the top, four components each (red, green, blue, opacity), uint8_t or
 * uint16_t as facts->bits says. Without an opacity it is the largest number. The caller frees them. NULL: *facts
 * names a format that is not read, and *e is unchanged; otherwise an error: input_damaged, input_unsupported,
 * limit_memory. `name` is that of the file; its ending identifies formats without a signature. */
void *image_decode(const unsigned char *data, size_t size, const char *name, const image_limits *limits,
                   image_facts *facts, error *e);

#endif
