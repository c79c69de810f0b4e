/* preview_png: the picture of a preview as PNG, 8 bit RGB, sRGB; through libpng. The same picture
 * gives the same bytes: no date, no text. A file belongs to one thread at a time. */
#ifndef HEXAD_FORMATS_PREVIEW_PNG_H
#define HEXAD_FORMATS_PREVIEW_PNG_H

#include <stdio.h>

#include "formats/preview.h"

/* Writes at the file's position and flushes; the caller made the file and syncs and renames it. */
bool preview_png_write(FILE *file, const image *picture, error *e);

/* Reads a seekable file from its start and says (internal) when it is not exactly the picture. */
bool preview_png_verify(FILE *file, const image *picture, error *e);

#endif
