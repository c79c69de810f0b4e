// SPDX-License-Identifier: Apache-2.0
#include "io/pictures/contact_sheet.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

/* Pixels. Text has twice the size of the font; below a thumbnail are its number and two gaps. */
enum {
    GAP = 8,
    SCALE = 2,
    TEXT = CANVAS_TEXT_HEIGHT * SCALE,
    CELL_WIDTH = THUMBNAIL_SIDE + GAP,
    CELL_HEIGHT = THUMBNAIL_SIDE + TEXT + 2 * GAP,
    TITLE_HEIGHT = TEXT + 2 * GAP
};

contact_sheet *contact_sheet_new(int count)
{
    contact_sheet *s = mem_alloc(sizeof *s);
    s->columns = 1;
    while (s->columns * s->columns < count) s->columns++;
    const int rows = (count + s->columns - 1) / s->columns;
    s->canvas = (canvas){
        .width = GAP + s->columns * CELL_WIDTH, .height = TITLE_HEIGHT + rows * CELL_HEIGHT, .scale = SCALE};
    const size_t bytes = 3 * (size_t)s->canvas.width * (size_t)s->canvas.height;
    s->canvas.rgb = mem_alloc(bytes);
    memset(s->canvas.rgb, 255, bytes);
    return s;
}

void contact_sheet_free(contact_sheet *s)
{
    if (!s) return;
    free(s->canvas.rgb);
    free(s);
}

void contact_sheet_put_title(contact_sheet *s, const char *title)
{
    canvas_text(&s->canvas, GAP, GAP, title);
}

static void copy_rows(const canvas *c, int x, int y, const thumbnail *picture)
{
    const size_t row = 3 * (size_t)picture->width;
    for (int k = 0; k < picture->height; k++)
        memcpy(c->rgb + 3 * ((size_t)(y + k) * (size_t)c->width + (size_t)x), picture->rgb + (size_t)k * row,
               row);
}

void contact_sheet_put(contact_sheet *s, int index, const thumbnail *picture, int number)
{
    char text[16];
    const int x = GAP + index % s->columns * CELL_WIDTH, y = TITLE_HEIGHT + index / s->columns * CELL_HEIGHT;
    snprintf(text, sizeof text, "%d", number);
    if (picture)
        copy_rows(&s->canvas, x + (THUMBNAIL_SIDE - picture->width) / 2,
                  y + (THUMBNAIL_SIDE - picture->height) / 2, picture);
    canvas_text(&s->canvas, x + (THUMBNAIL_SIDE - canvas_text_width(&s->canvas, text)) / 2,
                y + THUMBNAIL_SIDE + GAP / 2, text);
}
