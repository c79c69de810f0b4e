/* legend: a colour bar with a title and three numbers, drawn into an RGB picture. */
#ifndef HEXAD_FORMATS_LEGEND_H
#define HEXAD_FORMATS_LEGEND_H

#include "formats/colormap.h"

/* Pictures with a shorter side than this have no room for a legend and get none. */
enum { LEGEND_MIN_SIDE = 200 };

/* Height in pixels that the legend takes at the bottom of a picture; 0 where it gets none. */
int legend_height(int width, int height);

/* Draws the bar (none without a scale, nor its values), `title` at its left and `note` at its right end above it (beyond it where both are long), and the values at its
 * ends and middle below it. Letters (as small ones), digits and "+-.,/()=_" are drawn, others left blank.
 * `rgb` has 3 bytes a pixel, sRGB. */
void legend_draw(unsigned char *rgb, int width, int height, const colormap_scale *scale, const char *title,
                 const char *note);

/* A number of the legend as it is drawn: three significant digits. */
void legend_number(double value, char *out, int size);

#endif
