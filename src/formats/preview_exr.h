/* preview_exr: a preview with its data as OpenEXR, through OpenEXR's C core. One part, scanlines.
 * The same image gives the same bytes: no date, no path.
 *
 *     channels            type   what
 *     R G B A             half   linear light (Rec. 709 primaries), multiplied by coverage, no legend
 *     Z                   float  depth along the camera's axis; PREVIEW_FAR where nothing is
 *     id                  uint   index of the point in points.ply plus one; 0 where nothing is
 *  and of all channels
 *     P.X P.Y P.Z         float  the place on the disc, world space
 *     N.X N.Y N.Z         float  its normal, out of the solid
 *     kappa, spacing      float  the point's kappa and achieved spacing
 *
 * All but RGBA are those of the pixel's centre, never averaged, and 0 where nothing is (but Z). Of OpenEXR's
 * standard attributes worldToCamera is the matrix from world to camera space (right, up, forward: left-
 * handed), worldToNDC that to the picture, (0, 0) at its upper left and (1, 1) at its lower right corner;
 * both for row vectors. The screen window is that at depth 1 (of parallel cameras in world units).
 */
#ifndef HEXAD_FORMATS_PREVIEW_EXR_H
#define HEXAD_FORMATS_PREVIEW_EXR_H

#include <stdio.h>

#include "formats/preview.h"

/* By OpenEXR's names, all without loss: none, RLE and ZIPS pack each line by itself, ZIP 16 lines at once. */
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

/* Writes an empty file that is open for writing, from its start, through its descriptor (the
 * stream's own position is not moved); the caller made the file and syncs and renames it. */
bool preview_exr_write(FILE *file, const image *picture, const preview_exr_options *options, error *e);

/* Reads the file back through its descriptor and says (internal) when it does not hold exactly the
 * image. */
bool preview_exr_verify(FILE *file, const image *picture, const preview_exr_options *options, error *e);

#endif
