// SPDX-License-Identifier: Apache-2.0
/* colormap: maps numbers to colours, with a scale. Pure functions. */
#ifndef HEXAD_IO_POINTS_COLORMAP_H
#define HEXAD_IO_POINTS_COLORMAP_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"

/* viridis at t in [0, 1] (clamped): red, green, blue in sRGB, [0, 1]. Perceptually uniform, and readable
 * without colour. A polynomial of degree 6, published under CC0, within 0.01 of the published table. */
void colormap_viridis(double t, double srgb[3]);

typedef enum colormap_map {
    COLORMAP_VIRIDIS,
    COLORMAP_GRAY,
    COLORMAP_DIVERGING /* blue, nearly white at the centre, red */
} colormap_map;

/* The colour of t in [0, 1] (clamped) in pictures and legends: the map without its darkest part, which
 * shading would make black. */
void colormap_color(colormap_map map, double t, double srgb[3]);

/* Converts one channel from sRGB to linear light, both in [0, 1]. */
double colormap_linear(double srgb);

/* A scale from values to t: linear, or linear in the square root, which gives more colours to small
 * curvatures on surfaces with a few sharp places. */
typedef struct colormap_scale {
    double low, high; /* values at t = 0 and t = 1; low < high */
    bool root;        /* square root; values are not negative */
    colormap_map map;
} colormap_scale;

/* The scale for finite values (not negative with `root`): from their 2nd to their 98th percentile, so that
 * outliers do not use up the colours. Its range is at least `least` (> 0, unit of the values) and at least a
 * twentieth of its centre, so that noise is not shown as structure. False: out of memory. */
bool colormap_scale_of(const double *values, size_t count, bool root, double least, colormap_scale *out,
                       error *e);

double colormap_scale_place(const colormap_scale *s, double value); /* t, clamped to [0, 1] */
double colormap_scale_value(const colormap_scale *s, double t);

#endif
