// SPDX-License-Identifier: Apache-2.0
/* picture_png: writes a picture as PNG, 8-bit RGB, sRGB, with libpng. The same picture gives the same bytes:
 * no date, no text. A file belongs to one thread at a time.
 */
#ifndef HEXAD_IO_PICTURES_PICTURE_PNG_H
#define HEXAD_IO_PICTURES_PICTURE_PNG_H

#include <stdbool.h>
#include <stdio.h>

#include "base/core/error.h"
#include "io/pictures/canvas.h"

/* Writes at the current position and flushes. The caller creates, syncs and renames the file. Errors:
 * internal, limit_memory. */
bool picture_png_write(FILE *file, const canvas *picture, error *e);

#endif
