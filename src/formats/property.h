/* property: a point set as named arrays of vectors or numbers, as formats that keep components together write it. Pure
 * functions. */
#ifndef HEXAD_FORMATS_PROPERTY_H
#define HEXAD_FORMATS_PROPERTY_H

#include <stdbool.h>
#include <stddef.h>

#include "formats/points.h"

/* What formats have names of their own for. */
typedef enum property_role {
    PROPERTY_OTHER,
    PROPERTY_POSITION,
    PROPERTY_NORMAL,
    PROPERTY_COLOR, /* as a screen shows it */
    PROPERTY_UV,
    PROPERTY_RADIUS,
    PROPERTY_ID,
    PROPERTY_MOTION,  /* of the points from frame to frame, world units a frame */
    PROPERTY_VELOCITY /* of a file, which is before the motion */
} property_role;

typedef struct property {
    const char *name;
    property_role role;
    bool whole;     /* integers */
    double largest; /* of the whole numbers of an attribute, without signs */
    int components;
    const double *values; /* `components` a point, times `scale`; NULL: see `ids` */
    double scale;
    const uint32_t *ids; /* NULL beside no values: the places of the points, from 0 */
} property;

/* No more than so many beside the attributes. */
enum { PROPERTIES_OWN = 16 };

/* Fills in what the set has, in a fixed order; `list` has room for PROPERTIES_OWN and the attributes. Returns how many. */
size_t property_list(const points *set, property *list);

/* Whether an attribute is a velocity: a vector called v, vel or velocity. */
bool property_is_velocity(const point_attribute *a);

double property_value(const property *p, size_t point, int component);

#endif
