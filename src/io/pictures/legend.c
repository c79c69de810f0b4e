// SPDX-License-Identifier: Apache-2.0
#include "io/pictures/legend.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "io/pictures/canvas.h"

/* Layout in font pixels, from the bottom up: margin, numbers, tick, bar, gap, title, gap. */
enum { MARGIN = 7, TICK = 4, BAR = 6, GAP = 4 };

static int shorter(int a, int b)
{
    return a < b ? a : b;
}

/* Size of a font pixel in pixels. */
static int font_scale(int width, int height)
{
    int scale = (shorter(width, height) + 256) / 512;
    return scale > 0 ? scale : 1;
}

int legend_height(int width, int height)
{
    if (shorter(width, height) < LEGEND_MIN_SIDE) return 0;
    return (MARGIN + CANVAS_TEXT_HEIGHT + TICK + BAR + GAP + CANVAS_TEXT_HEIGHT + GAP) *
           font_scale(width, height);
}

void legend_number(double value, char *out, int size)
{
    snprintf(out, (size_t)size, "%.3g", value == 0 ? 0 : value);
}

void legend_draw(unsigned char *rgb, int width, int height, const colormap_scale *scale, const char *title,
                 const char *note)
{
    if (!legend_height(width, height)) return;
    canvas c = {rgb, width, height, font_scale(width, height)};
    int s = c.scale, bar_width = (int)(0.4 * width), left = (width - bar_width) / 2;
    int numbers = height - (MARGIN + CANVAS_TEXT_HEIGHT) * s, bar = numbers - (TICK + BAR) * s,
        titles = bar - (GAP + CANVAS_TEXT_HEIGHT) * s;
    for (int i = 0; scale && i < bar_width; i++) {
        double srgb[3];
        unsigned char color[3];
        colormap_color(scale->map, (double)i / (bar_width - 1), srgb);
        for (int k = 0; k < 3; k++) color[k] = (unsigned char)lround(255 * srgb[k]);
        canvas_fill(&c, left + i, bar, 1, BAR * s, color);
    }
    int end = left + canvas_text_width(&c, title), begin = left + bar_width - canvas_text_width(&c, note);
    canvas_text(&c, left, titles, title);
    canvas_text(&c, begin > end + GAP * s ? begin : end + GAP * s, titles, note);
    for (int k = 0; scale && k < 3; k++) {
        char number[32];
        int x = left + k * (bar_width - s) / 2;
        legend_number(colormap_scale_value(scale, 0.5 * k), number, sizeof number);
        int w = canvas_text_width(&c, number), from = k == 0   ? left
                                                      : k == 1 ? x - w / 2
                                                               : left + bar_width - w;
        canvas_fill(&c, x, bar + BAR * s, s, 2 * s, canvas_ink);
        canvas_text(&c, from, numbers, number);
    }
}
