/* preview_exr: a preview with its data as OpenEXR, through OpenEXR's C core. One part, scanlines,
 * not compressed. The same image gives the same bytes: no date, no path.
 *
 *     channels            type   what
 *     R G B A             half   linear light (Rec. 709 primaries), multiplied by coverage, no legend
 *     P.X P.Y P.Z         float  the place on the disc, world space
 *     N.X N.Y N.Z         float  its normal, out of the solid
 *     kappa, spacing      float  the point's kappa and achieved spacing
 *     Z                   float  depth along the camera's axis; PREVIEW_FAR where nothing is
 *     id                  uint   index of the point in points.ply plus one; 0 where nothing is
 *
 * All but RGBA are those of the pixel's centre, never averaged, and 0 where nothing is (but Z). The
 * attribute worldToCamera is the matrix from world to camera space (right, up, forward), row
 * vectors.
 */
#ifndef HEXAD_FORMATS_PREVIEW_EXR_H
#define HEXAD_FORMATS_PREVIEW_EXR_H

#include <stdio.h>

#include "formats/preview.h"

/* Writes an empty file that is open for writing, from its start, through its descriptor (the
 * stream's own position is not moved); the caller made the file and syncs and renames it. */
bool preview_exr_write(FILE *file, const image *picture, error *e);

/* Reads the file back through its descriptor and says (internal) when it does not hold exactly the
 * image. */
bool preview_exr_verify(FILE *file, const image *picture, error *e);

#endif
