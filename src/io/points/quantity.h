// SPDX-License-Identifier: Apache-2.0
/* quantity: the quantity that the colours of a picture show, and its scale. Pure functions. */
#ifndef HEXAD_IO_POINTS_QUANTITY_H
#define HEXAD_IO_POINTS_QUANTITY_H

#include "base/core/error.h"
#include "io/points/colormap.h"
#include "io/points/points.h"

typedef enum quantity {
    QUANTITY_ALPHA,
    QUANTITY_CURVATURE, /* kappa */
    QUANTITY_ENERGY,
    QUANTITY_SPACING, /* achieved spacing */
    QUANTITY_DEGREE,  /* number of neighbours, if the set has it */
    QUANTITY_VALUES,  /* values of the look, from an attribute */
    QUANTITY_COLOR,   /* colours of the look, three values per point, sRGB; no scale */
    QUANTITY_SHADING /* one colour for all points, which pictures shade by the normals; no values, no scale */
} quantity;

typedef struct quantity_look {
    quantity which;
    double low, high; /* range of the scale; equal: from the values */
    colormap_map map;
    const char *title;    /* NULL: that of the quantity */
    const double *values; /* for QUANTITY_VALUES and QUANTITY_COLOR */
} quantity_look;

/* Whether the quantity is defined at point i. Points at which it is not are grey. */
static inline bool quantity_is_defined(const points *set, const quantity_look *look, size_t i)
{
    return look->which != QUANTITY_CURVATURE || !set->kappa_defined || set->kappa_defined[i] != 0;
}

/* The color of points at which the quantity is undefined: a grey that no map has, sRGB. */
extern const double quantity_undefined_color[3];

/* Whether the quantity has a scale. */
bool quantity_has_scale(quantity which);

/* The values, one per point; owned by the set or the look. NULL: none. */
const double *quantity_values(const points *set, const quantity_look *look);

/* The title in the legend. */
const char *quantity_title(const quantity_look *look);

/* The scale of the values. `extent`: half diagonal of the set, world units, relative to which small ranges of
 * lengths and curvatures are ignored. False: out of memory. */
bool quantity_scale(const points *set, const quantity_look *look, double extent, colormap_scale *out,
                    error *e);

/* The colour of each point (sRGB, 0 to 1), by a quantity with a scale. False: out of memory. */
bool quantity_colors(const points *set, const quantity_look *look, vec3 *out, error *e);

#endif
