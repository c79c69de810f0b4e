// SPDX-License-Identifier: Apache-2.0
/* legend: a colour bar with a title and three numbers, drawn into an RGB picture. */
#ifndef HEXAD_IO_PICTURES_LEGEND_H
#define HEXAD_IO_PICTURES_LEGEND_H

#include "io/points/colormap.h"

/* Minimum length of the shorter side of a picture, pixels; smaller pictures have no legend. */
enum { LEGEND_MIN_SIDE = 200 };

/* Height of the legend at the bottom of a picture, pixels; 0: no legend. */
int legend_height(int width, int height);

/* Draws the colour bar and the values at its ends and centre below it, unless `scale` is NULL. `title` is
 * above its left end; `note` is above its right end, or beyond it if both are long. Letters (in lower case),
 * digits and "+-.,/()=_" are drawn; other characters are blank. `rgb` has 3 bytes per pixel, sRGB. */
void legend_draw(unsigned char *rgb, int width, int height, const colormap_scale *scale, const char *title,
                 const char *note);

/* Formats a number of the legend: three significant digits. */
void legend_number(double value, char *out, int size);

#endif
