/* tiff_description: what the text ImageDescription of a TIFF file says of its pages: ImageJ's lines, or OME-XML (by expat).
 *
 * Runs in the process that reads. Pure functions; any thread.
 */
#ifndef HEXAD_DENSE_TIFF_DESCRIPTION_H
#define HEXAD_DENSE_TIFF_DESCRIPTION_H

#include <stdbool.h>
#include <stdint.h>

#include "dense/warnings.h"

enum { TIFF_UNIT_SIZE = 40, TIFF_FAULT_SIZE = 256 };

typedef struct tiff_description {
    const char *kind;                 /* "ImageJ" or "OME-XML"; NULL: the text is neither */
    int64_t images;                   /* ImageJ: pages, also of a file with only one directory; 0: unknown */
    int64_t slices, channels, frames; /* at least 1, if `kind` */
    int64_t slice_step, channel_step, frame_step; /* pages from one to the next */
    double size[3];                               /* of a voxel; 0: unknown */
    double origin[3];                             /* pixel at the world's origin, ImageJ */
    char unit[TIFF_UNIT_SIZE];                    /* of size; "": unknown */
} tiff_description;

/* False, and a message in `fault`: the text is OME-XML that is not valid, or describes what is not read. */
bool tiff_describe(const char *text, tiff_description *out, dense_warnings *warnings,
                   char fault[TIFF_FAULT_SIZE]);

#endif
