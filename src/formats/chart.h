/* chart: curves over one axis, each in a panel of its own, one below the other. */
#ifndef HEXAD_FORMATS_CHART_H
#define HEXAD_FORMATS_CHART_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"
#include "formats/canvas.h"

typedef struct chart_curve {
    const char *title;    /* in the letters of a canvas */
    const double *values; /* those that are not finite, or with `decades` not positive, are gaps */
    bool decades;         /* a logarithmic axis */
} chart_curve;

typedef struct chart {
    const char *axis; /* what is counted along the values, from 1 */
    size_t count;     /* values a curve, > 0 */
    const chart_curve *curves;
    int curve_count;
} chart;

/* Draws into a new picture, whose rgb the caller frees. Error: limit_memory. */
bool chart_draw(const chart *what, int width, int height, canvas *out, error *e);

/* The distance of ticks along an axis that spans `range` > 0, of which `most` at most fit: 1, 2 or 5 times
 * a power of ten. */
double chart_tick(double range, int most);

#endif
