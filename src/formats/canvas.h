/* canvas: a picture of 8-bit sRGB to fill rectangles of and to write on, in a font of its own: digits,
 * small letters and what numbers need. Pure functions. */
#ifndef HEXAD_FORMATS_CANVAS_H
#define HEXAD_FORMATS_CANVAS_H

/* Heights and distances of text are in font pixels, which are squares of `scale` pixels. */
enum { CANVAS_TEXT_HEIGHT = 7 };

typedef struct canvas {
    unsigned char *rgb; /* 3 a pixel, rows from the top */
    int width, height;
    int scale;
} canvas;

extern const unsigned char canvas_ink[3]; /* a dark grey, of text and lines */

/* What lies outside of the picture is left out. */
void canvas_fill(const canvas *c, int x, int y, int width, int height, const unsigned char color[3]);

/* From the top left. Letters that the font does not have are left blank. */
void canvas_text(const canvas *c, int x, int y, const char *text);
int canvas_text_width(const canvas *c, const char *text); /* pixels */

#endif
