/* colormap: numbers to colours, and the scale between them. Pure functions. */
#ifndef HEXAD_FORMATS_COLORMAP_H
#define HEXAD_FORMATS_COLORMAP_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"

/* viridis, even to the eye and readable without colour, at t in [0, 1] (clamped): red, green, blue
 * in sRGB, [0, 1]. Within 0.01 of the published table: it is a polynomial fit of degree 6 that was
 * published under CC0. */
void colormap_viridis(double t, double srgb[3]);

typedef enum colormap_map {
    COLORMAP_VIRIDIS,
    COLORMAP_GRAY,
    COLORMAP_DIVERGING /* blue, nearly white in the middle, red */
} colormap_map;

/* The colour of t in [0, 1] (clamped) in pictures and legends: the map without its darkest part, which shading would
 * turn black. */
void colormap_color(colormap_map map, double t, double srgb[3]);

/* One channel from sRGB to light, both in [0, 1]. */
double colormap_linear(double srgb);

/* Where values lie between the colours: linear, or linear in the square root, which gives the small
 * curvatures of a surface with a few sharp spots their share of the colours. */
typedef struct colormap_scale {
    double low, high; /* the values of t = 0 and 1; low < high */
    bool root;        /* values are not negative */
    colormap_map map;
} colormap_scale;

/* The scale of values that are finite (and not negative with `root`): from their 2nd to their 98th
 * percentile, so that a few outliers do not take all the colours; but at least `least` wide (> 0,
 * in the values' unit) and a twentieth of its middle, so that noise is not painted as structure.
 * False: no memory. */
bool colormap_scale_of(const double *values, size_t count, bool root, double least, colormap_scale *out,
                       error *e);

double colormap_scale_place(const colormap_scale *s, double value); /* t, clamped to [0, 1] */
double colormap_scale_value(const colormap_scale *s, double t);

#endif
