// SPDX-License-Identifier: Apache-2.0
/* canvas: an 8-bit sRGB picture with functions to fill rectangles and write text, in a built-in font of
 * digits, small letters and the characters of numbers. Pure functions.
 */
#ifndef HEXAD_IO_PICTURES_CANVAS_H
#define HEXAD_IO_PICTURES_CANVAS_H

/* Sizes of text are in font pixels, which are squares of `scale` pixels. */
enum { CANVAS_TEXT_HEIGHT = 7 };

typedef struct canvas {
    unsigned char *rgb; /* 3 bytes per pixel, rows from the top */
    int width, height;
    int scale;
} canvas;

extern const unsigned char canvas_ink[3]; /* dark grey, for text and lines */

/* Fills a rectangle, clipped to the picture. */
void canvas_fill(const canvas *c, int x, int y, int width, int height, const unsigned char color[3]);

/* Writes text with its top left corner at (x, y). Characters that the font lacks are blank. */
void canvas_text(const canvas *c, int x, int y, const char *text);
int canvas_text_width(const canvas *c, const char *text); /* pixels */

#endif
