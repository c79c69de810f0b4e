/* contact_sheet: thumbnails in a grid, each with a number below it, and a line of text above. One owner. */
#ifndef HEXAD_FORMATS_CONTACT_SHEET_H
#define HEXAD_FORMATS_CONTACT_SHEET_H

#include "formats/canvas.h"
#include "formats/thumbnail.h"

/* Thumbnails of one sheet, at most: 16 rows of 16, in a picture of 2192 x 2457 pixels. */
enum { CONTACT_SHEET_MOST = 256 };

typedef struct contact_sheet {
    canvas canvas; /* the picture; white where nothing is */
    int columns;
} contact_sheet;

/* Room for `count` thumbnails, from 1 to CONTACT_SHEET_MOST: as many columns as rows, or one more. The caller frees with
 * contact_sheet_free. */
contact_sheet *contact_sheet_new(int count);
void contact_sheet_free(contact_sheet *sheet); /* accepts NULL */

/* Writes a line above the thumbnails, cut at the right border. Called once. */
void contact_sheet_put_title(contact_sheet *sheet, const char *title);

/* Places a thumbnail, by its index from 0, row after row; NULL: only the number is written. */
void contact_sheet_put(contact_sheet *sheet, int index, const thumbnail *picture, int number);

#endif
