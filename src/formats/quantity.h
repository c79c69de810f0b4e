/* quantity: what the colours of a picture show of the points, and the scale that suits it. Pure functions. */
#ifndef HEXAD_FORMATS_QUANTITY_H
#define HEXAD_FORMATS_QUANTITY_H

#include "base/error.h"
#include "formats/colormap.h"
#include "formats/points.h"

typedef enum quantity {
    QUANTITY_ALPHA,
    QUANTITY_CURVATURE, /* kappa */
    QUANTITY_ENERGY,
    QUANTITY_SPACING, /* the achieved one */
    QUANTITY_DEGREE,  /* of sets that have it */
    QUANTITY_VALUES,  /* of the look: of an attribute */
    QUANTITY_COLOR /* likewise, three a point: colours as a screen shows them, which no scale has part in */
} quantity;

typedef struct quantity_look {
    quantity which;
    double low, high; /* of the scale; the same: those of the values */
    colormap_map map;
    const char *title;    /* NULL: the quantity's own */
    const double *values; /* of QUANTITY_VALUES and QUANTITY_COLOR */
} quantity_look;

/* One value a point; the set's array, or the look's. */
const double *quantity_values(const points *set, const quantity_look *look);

/* As the legend calls it. */
const char *quantity_title(const quantity_look *look);

/* `extent`: of the set, to tell what range of a length or a curvature is nothing. False: no memory. */
bool quantity_scale(const points *set, const quantity_look *look, double extent, colormap_scale *out,
                    error *e);

/* The colour that pictures give each point, as a screen shows it (sRGB, 0 to 1). False: no memory. */
bool quantity_colors(const points *set, const quantity_look *look, vec3 *out, error *e);

#endif
