#include "formats/legend.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Layout in font pixels, from the bottom up: margin, numbers, tick, bar, gap, title, gap. */
enum { GLYPH_W = 5, GLYPH_H = 7, ADVANCE = 6, MARGIN = 7, TICK = 4, BAR = 6, GAP = 4 };
enum { INK = 45 }; /* grey of text and ticks */

typedef struct glyph {
    char letter;
    unsigned char column[GLYPH_W]; /* bit 0 is the top row */
} glyph;

static const glyph font[] = {
    {'0', {0x3E, 0x51, 0x49, 0x45, 0x3E}}, {'1', {0x00, 0x42, 0x7F, 0x40, 0x00}},
    {'2', {0x42, 0x61, 0x51, 0x49, 0x46}}, {'3', {0x21, 0x41, 0x45, 0x4B, 0x31}},
    {'4', {0x18, 0x14, 0x12, 0x7F, 0x10}}, {'5', {0x27, 0x45, 0x45, 0x45, 0x39}},
    {'6', {0x3C, 0x4A, 0x49, 0x49, 0x30}}, {'7', {0x01, 0x71, 0x09, 0x05, 0x03}},
    {'8', {0x36, 0x49, 0x49, 0x49, 0x36}}, {'9', {0x06, 0x49, 0x49, 0x29, 0x1E}},
    {'a', {0x20, 0x54, 0x54, 0x54, 0x78}}, {'b', {0x7F, 0x48, 0x44, 0x44, 0x38}},
    {'c', {0x38, 0x44, 0x44, 0x44, 0x20}}, {'d', {0x38, 0x44, 0x44, 0x48, 0x7F}},
    {'e', {0x38, 0x54, 0x54, 0x54, 0x18}}, {'f', {0x08, 0x7E, 0x09, 0x01, 0x02}},
    {'g', {0x0C, 0x52, 0x52, 0x52, 0x3E}}, {'h', {0x7F, 0x08, 0x04, 0x04, 0x78}},
    {'i', {0x00, 0x44, 0x7D, 0x40, 0x00}}, {'j', {0x20, 0x40, 0x44, 0x3D, 0x00}},
    {'k', {0x7F, 0x10, 0x28, 0x44, 0x00}}, {'l', {0x00, 0x41, 0x7F, 0x40, 0x00}},
    {'m', {0x7C, 0x04, 0x18, 0x04, 0x78}}, {'n', {0x7C, 0x08, 0x04, 0x04, 0x78}},
    {'o', {0x38, 0x44, 0x44, 0x44, 0x38}}, {'p', {0x7C, 0x14, 0x14, 0x14, 0x08}},
    {'q', {0x08, 0x14, 0x14, 0x18, 0x7C}}, {'r', {0x7C, 0x08, 0x04, 0x04, 0x08}},
    {'s', {0x48, 0x54, 0x54, 0x54, 0x20}}, {'t', {0x04, 0x3F, 0x44, 0x40, 0x20}},
    {'u', {0x3C, 0x40, 0x40, 0x20, 0x7C}}, {'v', {0x1C, 0x20, 0x40, 0x20, 0x1C}},
    {'w', {0x3C, 0x40, 0x30, 0x40, 0x3C}}, {'x', {0x44, 0x28, 0x10, 0x28, 0x44}},
    {'y', {0x0C, 0x50, 0x50, 0x50, 0x3C}}, {'z', {0x44, 0x64, 0x54, 0x4C, 0x44}},
    {'+', {0x08, 0x08, 0x3E, 0x08, 0x08}}, {'-', {0x08, 0x08, 0x08, 0x08, 0x08}},
    {'.', {0x00, 0x60, 0x60, 0x00, 0x00}}, {',', {0x00, 0x50, 0x30, 0x00, 0x00}},
    {'/', {0x20, 0x10, 0x08, 0x04, 0x02}}, {'(', {0x00, 0x1C, 0x22, 0x41, 0x00}},
    {')', {0x00, 0x41, 0x22, 0x1C, 0x00}}, {'=', {0x14, 0x14, 0x14, 0x14, 0x14}},
};

typedef struct canvas {
    unsigned char *rgb;
    int width, height, scale;
} canvas;

static int shorter(int a, int b)
{
    return a < b ? a : b;
}

/* Font pixels are squares of so many pixels. */
static int font_scale(int width, int height)
{
    int scale = (shorter(width, height) + 256) / 512;
    return scale > 0 ? scale : 1;
}

int legend_height(int width, int height)
{
    if (shorter(width, height) < LEGEND_MIN_SIDE) return 0;
    return (MARGIN + GLYPH_H + TICK + BAR + GAP + GLYPH_H + GAP) * font_scale(width, height);
}

void legend_number(double value, char *out, int size)
{
    snprintf(out, (size_t)size, "%.3g", value == 0 ? 0 : value);
}

static void fill(const canvas *c, int x, int y, int w, int h, const unsigned char color[3])
{
    for (int j = y < 0 ? 0 : y; j < y + h && j < c->height; j++)
        for (int i = x < 0 ? 0 : x; i < x + w && i < c->width; i++)
            memcpy(c->rgb + 3 * ((size_t)j * (size_t)c->width + (size_t)i), color, 3);
}

static int text_width(const canvas *c, const char *text)
{
    return ((int)strlen(text) * ADVANCE - (ADVANCE - GLYPH_W)) * c->scale;
}

static void draw_text(const canvas *c, int x, int y, const char *text)
{
    static const unsigned char ink[3] = {INK, INK, INK};
    for (; *text; text++, x += ADVANCE * c->scale)
        for (size_t g = 0; g < sizeof font / sizeof *font; g++) {
            if (font[g].letter != *text) continue;
            for (int i = 0; i < GLYPH_W; i++)
                for (int j = 0; j < GLYPH_H; j++)
                    if (font[g].column[i] >> j & 1)
                        fill(c, x + i * c->scale, y + j * c->scale, c->scale, c->scale, ink);
        }
}

void legend_draw(unsigned char *rgb, int width, int height, const colormap_scale *scale,
                 const char *title, const char *note)
{
    if (!legend_height(width, height)) return;
    static const unsigned char ink[3] = {INK, INK, INK};
    canvas c = {rgb, width, height, font_scale(width, height)};
    int s = c.scale, bar_width = (int)(0.4 * width), left = (width - bar_width) / 2;
    int numbers = height - (MARGIN + GLYPH_H) * s, bar = numbers - (TICK + BAR) * s,
        titles = bar - (GAP + GLYPH_H) * s;
    for (int i = 0; i < bar_width; i++) {
        double srgb[3];
        unsigned char color[3];
        colormap_color((double)i / (bar_width - 1), srgb);
        for (int k = 0; k < 3; k++) color[k] = (unsigned char)lround(255 * srgb[k]);
        fill(&c, left + i, bar, 1, BAR * s, color);
    }
    draw_text(&c, left, titles, title);
    draw_text(&c, left + bar_width - text_width(&c, note), titles, note);
    for (int k = 0; k < 3; k++) {
        char number[32];
        int x = left + k * (bar_width - s) / 2;
        legend_number(colormap_scale_value(scale, 0.5 * k), number, sizeof number);
        int w = text_width(&c, number), from = k == 0   ? left
                                               : k == 1 ? x - w / 2
                                                        : left + bar_width - w;
        fill(&c, x, bar + BAR * s, s, 2 * s, ink);
        draw_text(&c, from, numbers, number);
    }
}
