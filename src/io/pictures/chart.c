// SPDX-License-Identifier: Apache-2.0
#include "io/pictures/chart.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"

/* Layout in font pixels. */
enum { SCALE = 2, LEFT = 44, RIGHT = 10, TOP = 14, BETWEEN = 16, BOTTOM = 22, GAP = 3, LINE = 1 };
enum { TICKS_ACROSS = 8, TICKS_UP = 5 };
/* Fraction of the height of a panel that is free above and below its curve. */
static const double margin_share = 0.06;

static const unsigned char paper[3] = {255, 255, 255}, grid[3] = {222, 222, 222},
                           curve_color[3] = {33, 97, 140};

/* The area of a curve, and the values at its lower and upper edge (decades: their logarithms). */
typedef struct panel {
    int x, y, width, height; /* pixels */
    double low, high;
} panel;

double chart_tick(double range, int most)
{
    double least = range / most, power = elementary_pow(10, floor(elementary_log10(least)));
    for (double step = 1; step <= 5; step = step < 2 ? 2 : 5) {
        if (step * power >= least * (1 - 1e-9)) return step * power;
        if (step == 5) break;
    }
    return 10 * power;
}

/* Value k, or its logarithm; NAN in a gap. */
static double value_of(const chart_curve *c, size_t k)
{
    double value = c->values[k];
    if (c->decades) value = value > 0 ? elementary_log10(value) : NAN;
    return isfinite(value) ? value : NAN;
}

/* Linear interpolation between values; index 0 is the first. */
static double value_at(const chart_curve *c, size_t count, double at)
{
    at = fmin(fmax(at, 0), (double)(count - 1));
    size_t before = (size_t)at, after = before + 1 < count ? before + 1 : before;
    double share = at - (double)before;
    return share > 0 ? (1 - share) * value_of(c, before) + share * value_of(c, after) : value_of(c, before);
}

static void choose_range(const chart_curve *c, size_t count, panel *p)
{
    double low = INFINITY, high = -INFINITY;
    for (size_t k = 0; k < count; k++) { /* fmin and fmax ignore NaN */
        low = fmin(low, value_of(c, k));
        high = fmax(high, value_of(c, k));
    }
    if (!(low <= high)) low = high = 0;
    double least = c->decades ? 1 : fmax(1e-3 * fabs(high), 1e-12); /* a range that exceeds rounding errors */
    double room = fmax(margin_share * (high - low), 0.5 * (least - (high - low)));
    p->low = low - room;
    p->high = high + room;
}

static int row_of(const panel *p, double value)
{
    return p->y + (int)lround((p->high - value) / (p->high - p->low) * (p->height - 1));
}

static void draw_axis_up(const canvas *c, const panel *p, bool decades)
{
    double step = chart_tick(p->high - p->low, TICKS_UP);
    if (decades) step = fmax(step, 1);
    for (double k = ceil(p->low / step); k * step <= p->high; k++) {
        char number[32];
        int y = row_of(p, k * step);
        snprintf(number, sizeof number, decades ? "1e%.0f" : "%.5g", k == 0 ? 0 : k * step);
        canvas_fill(c, p->x, y, p->width, c->scale / 2, grid);
        canvas_text(c, p->x - GAP * c->scale - canvas_text_width(c, number),
                    y - CANVAS_TEXT_HEIGHT * c->scale / 2, number);
    }
}

/* Position of value k (from 0), pixels. */
static double position_of(const panel *p, size_t count, double k)
{
    return count > 1 ? p->x + k / (double)(count - 1) * (p->width - 1) : p->x;
}

static void draw_axis_across(const canvas *c, const panel *p, size_t count, bool numbered)
{
    double step = fmax(chart_tick(fmax((double)count - 1, 1), TICKS_ACROSS), 1);
    for (double k = ceil(1 / step); k * step <= (double)count; k++) {
        char number[32];
        int x = (int)lround(position_of(p, count, k * step - 1));
        canvas_fill(c, x, p->y, c->scale / 2, p->height, grid);
        if (!numbered) continue;
        snprintf(number, sizeof number, "%.0f", k * step);
        canvas_text(c, x - canvas_text_width(c, number) / 2, p->y + p->height + GAP * c->scale, number);
    }
}

static void draw_frame(const canvas *c, const panel *p)
{
    int line = c->scale / 2;
    canvas_fill(c, p->x, p->y, p->width, line, canvas_ink);
    canvas_fill(c, p->x, p->y + p->height - line, p->width, line, canvas_ink);
    canvas_fill(c, p->x, p->y, line, p->height, canvas_ink);
    canvas_fill(c, p->x + p->width - line, p->y, line, p->height, canvas_ink);
}

/* Draws column by column: from the minimum to the maximum of the values in the column and at its borders. */
static void draw_curve(const canvas *c, const panel *p, const chart_curve *curve, size_t count)
{
    double per_column = count > 1 ? (double)(count - 1) / (p->width - 1) : 0;
    int thick = LINE * c->scale;
    for (int x = 0; x < p->width; x++) {
        double from = (x - 0.5) * per_column, to = (x + 0.5) * per_column;
        double low = value_at(curve, count, from), high = low, last = value_at(curve, count, to);
        low = fmin(low, last); /* either may be NaN */
        high = fmax(high, last);
        for (double k = fmax(ceil(from), 0); k <= to && k < (double)count; k++) {
            low = fmin(low, value_of(curve, (size_t)k));
            high = fmax(high, value_of(curve, (size_t)k));
        }
        if (!(low <= high)) continue;
        int top = row_of(p, high), bottom = row_of(p, low);
        canvas_fill(c, p->x + x - thick / 2, top - thick / 2, thick, bottom - top + thick, curve_color);
    }
}

bool chart_draw(const chart *what, int width, int height, canvas *out, error *e)
{
    canvas c = {mem_array((size_t)width * (size_t)height, 3, "a chart", e), width, height, SCALE};
    if (!c.rgb) return false;
    canvas_fill(&c, 0, 0, width, height, paper);
    int free_height = height - (TOP + BOTTOM + BETWEEN * (what->curve_count - 1)) * SCALE;
    int each = free_height / what->curve_count;
    for (int k = 0; k < what->curve_count; k++) {
        const chart_curve *curve = &what->curves[k];
        bool last = k == what->curve_count - 1;
        panel p = {.x = LEFT * SCALE, .width = width - (LEFT + RIGHT) * SCALE, .height = each};
        p.y = TOP * SCALE + k * (each + BETWEEN * SCALE);
        choose_range(curve, what->count, &p);
        draw_axis_up(&c, &p, curve->decades);
        draw_axis_across(&c, &p, what->count, last);
        draw_frame(&c, &p);
        draw_curve(&c, &p, curve, what->count);
        canvas_text(&c, p.x, p.y - (CANVAS_TEXT_HEIGHT + GAP) * SCALE, curve->title);
        if (last)
            canvas_text(&c, p.x + (p.width - canvas_text_width(&c, what->axis)) / 2,
                        p.y + each + (2 * GAP + CANVAS_TEXT_HEIGHT) * SCALE, what->axis);
    }
    *out = c;
    return true;
}
