// SPDX-License-Identifier: Apache-2.0
/* chart: curves over one axis, each in its own panel, stacked vertically. */
#ifndef HEXAD_IO_PICTURES_CHART_H
#define HEXAD_IO_PICTURES_CHART_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"
#include "io/pictures/canvas.h"

typedef struct chart_curve {
    const char *title;    /* characters of the canvas font */
    const double *values; /* gaps: values that are not finite, and with `decades` values <= 0 */
    bool decades;         /* logarithmic axis */
} chart_curve;

typedef struct chart {
    const char *axis; /* title of the axis, which counts values from 1 */
    size_t count;     /* values per curve, > 0 */
    const chart_curve *curves;
    int curve_count;
} chart;

/* Draws into a new picture, whose rgb the caller frees. Error: limit_memory. */
bool chart_draw(const chart *what, int width, int height, canvas *out, error *e);

/* The distance of ticks along an axis that spans `range` > 0, for at most `most` ticks: 1, 2 or 5 times a
 * power of ten. */
double chart_tick(double range, int most);

#endif
