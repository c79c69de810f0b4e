// SPDX-License-Identifier: Apache-2.0
/* preview_exr: writes a preview with its data as OpenEXR, with OpenEXR's C core: one part, scanlines. The
 * same image gives the same bytes: no date, no path.
 *
 *     channels            type   contents
 *     R G B A             half   linear light (Rec. 709 primaries), premultiplied by coverage, no legend
 *     Z                   float  depth along the camera's axis; PREVIEW_FAR if empty
 *     id                  uint   index of the point in points.ply plus 1; 0 if empty
 *  with all_channels also
 *     P.X P.Y P.Z         float  the place on the disc, world space
 *     N.X N.Y N.Z         float  its normal, out of the solid
 *     kappa, spacing      float  the point's kappa and achieved spacing
 *
 * All channels except RGBA are those of the centre of the pixel, never averaged, and 0 if empty (except Z).
 * Standard attributes: worldToCamera is the matrix from world to camera space (right, up, forward:
 * left-handed); worldToNDC is the matrix to the picture, (0, 0) at its upper left and (1, 1) at its lower
 * right corner; both are for row vectors. The screen window is at depth 1 (orthographic cameras: in world
 * units).
 */
#ifndef HEXAD_IO_PICTURES_PREVIEW_EXR_H
#define HEXAD_IO_PICTURES_PREVIEW_EXR_H

#include <stdio.h>

#include "io/pictures/preview.h"

/* Lossless compressions, by OpenEXR's names. None, RLE and ZIPS compress each line separately, ZIP 16 lines
 * together. */
typedef enum preview_exr_packing {
    PREVIEW_EXR_NONE,
    PREVIEW_EXR_RLE,
    PREVIEW_EXR_ZIPS,
    PREVIEW_EXR_ZIP
} preview_exr_packing;

typedef struct preview_exr_options {
    preview_exr_packing packing;
    bool all_channels;
} preview_exr_options;

/* Writes to an empty file from its start, and flushes it. The caller creates, syncs and renames the file.
 * Errors: storage_full, storage_failed, internal, limit_memory. */
bool preview_exr_write(FILE *file, const image *picture, const preview_exr_options *options, error *e);

#endif
