// SPDX-License-Identifier: Apache-2.0
/* contact_sheet: a grid of numbered thumbnails below a line of text. One thread at a time. */
#ifndef HEXAD_IO_PICTURES_CONTACT_SHEET_H
#define HEXAD_IO_PICTURES_CONTACT_SHEET_H

#include "io/pictures/canvas.h"
#include "io/pictures/thumbnail.h"

/* Maximum number of thumbnails: 16 rows of 16, in a picture of 2192 x 2457 pixels. */
enum { CONTACT_SHEET_MOST = 256 };

typedef struct contact_sheet {
    canvas canvas; /* the picture, with a white background */
    int columns;
} contact_sheet;

/* Creates a sheet for `count` thumbnails, from 1 to CONTACT_SHEET_MOST, with as many columns as rows, or one
 * more. The caller frees it with contact_sheet_free. */
contact_sheet *contact_sheet_new(int count);
void contact_sheet_free(contact_sheet *sheet); /* accepts NULL */

/* Writes a line above the thumbnails, clipped at the right border. Call it once. */
void contact_sheet_put_title(contact_sheet *sheet, const char *title);

/* Draws a thumbnail at its index, from 0, row by row; NULL: only the number. */
void contact_sheet_put(contact_sheet *sheet, int index, const thumbnail *picture, int number);

#endif
