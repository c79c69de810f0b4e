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
    QUANTITY_DEGREE   /* of sets that have it */
} quantity;

/* One value a point; the set's array. */
const double *quantity_values(const points *set, quantity which);

/* As the legend calls it. */
const char *quantity_title(quantity which);

/* `extent`: of the set, to tell what range of a length or a curvature is nothing. False: no memory. */
bool quantity_scale(const points *set, quantity which, double extent, colormap_scale *out, error *e);

/* The colour that pictures give each point, as a screen shows it (sRGB, 0 to 1). False: no memory. */
bool quantity_colors(const points *set, quantity which, vec3 *out, error *e);

#endif
