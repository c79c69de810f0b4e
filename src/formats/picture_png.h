/* picture_png: a picture as PNG, 8 bit RGB, sRGB; through libpng. The same picture
 * gives the same bytes: no date, no text. A file belongs to one thread at a time. */
#ifndef HEXAD_FORMATS_PICTURE_PNG_H
#define HEXAD_FORMATS_PICTURE_PNG_H

#include <stdbool.h>
#include <stdio.h>

#include "base/error.h"
#include "formats/canvas.h"

/* Writes at the file's position and flushes; the caller made the file and syncs and renames it. */
bool picture_png_write(FILE *file, const canvas *picture, error *e);

/* Reads a seekable file from its start and says (internal) when it is not exactly the picture. */
bool picture_png_verify(FILE *file, const canvas *picture, error *e);

#endif
