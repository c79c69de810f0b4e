// SPDX-License-Identifier: Apache-2.0
/* tiff_description: parses the ImageDescription of a TIFF file, which describes its pages: ImageJ's lines, or
 * OME-XML (with expat).
 *
 * Runs in the process that reads the file. Pure functions; any thread.
 */
#ifndef HEXAD_IO_VOLUMES_TIFF_DESCRIPTION_H
#define HEXAD_IO_VOLUMES_TIFF_DESCRIPTION_H

#include <stdbool.h>
#include <stdint.h>

#include "io/volumes/warnings.h"

enum { TIFF_UNIT_SIZE = 40, TIFF_FAULT_SIZE = 256 };

typedef struct tiff_description {
    const char *kind; /* "ImageJ" or "OME-XML"; NULL: the text is neither */
    /* ImageJ: number of pages, also of a file with a single directory; 0: unknown */
    int64_t images;
    int64_t slices, channels, frames; /* at least 1, if `kind` */
    int64_t width, height;            /* OME-XML; 0: not stated */
    char type[16];                    /* of the numbers, such as "uint16"; OME-XML; "": not stated */
    /* distance, in pages, between consecutive slices, channels, frames */
    int64_t slice_step, channel_step, frame_step;
    double size[3];            /* of a voxel; 0: unknown */
    double in_unit[3];         /* factors: sizes along each axis, as stored in the file, to `unit`; ImageJ */
    double origin[3];          /* pixel at the origin of the world, ImageJ */
    char unit[TIFF_UNIT_SIZE]; /* unit of `size`; "": unknown */
} tiff_description;

/* False, with a message in `fault`: the text is not valid or not supported. */
bool tiff_describe(const char *text, tiff_description *out, dense_warnings *warnings,
                   char fault[TIFF_FAULT_SIZE]);

#endif
