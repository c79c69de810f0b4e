// SPDX-License-Identifier: Apache-2.0
/* property: a point set as named arrays of vectors or numbers, for formats that keep components together.
 * Pure functions.
 */
#ifndef HEXAD_IO_POINTS_PROPERTY_H
#define HEXAD_IO_POINTS_PROPERTY_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"
#include "io/points/points.h"

/* Roles for which formats have special names. */
typedef enum property_role {
    PROPERTY_OTHER,
    PROPERTY_POSITION,
    PROPERTY_NORMAL,
    PROPERTY_COLOR, /* sRGB */
    PROPERTY_UV,
    PROPERTY_RADIUS,
    PROPERTY_ID,
    PROPERTY_MOTION,   /* motion of the points between frames, world units per frame */
    PROPERTY_VELOCITY, /* velocity from a file; takes precedence over the motion */
    PROPERTY_ORIENT,   /* quaternion x y z w */
    /* of instances in USD */
    PROPERTY_INSTANCE_ORIENT,
    PROPERTY_INSTANCE_ORIENT_HALF, /* the same, for numbers of 16 bits */
    PROPERTY_INSTANCE_SCALE,
    PROPERTY_INSTANCE_PROTOTYPE /* number of the prototype */
} property_role;

typedef struct property {
    const char *name;
    property_role role;
    bool whole;     /* integers */
    double largest; /* maximum absolute value of an integer attribute */
    int components;
    const double *values; /* `components` per point, times `scale`; NULL: see `ids` */
    double scale;
    bool is_double;      /* real numbers that are doubles where the format has them */
    const uint32_t *ids; /* NULL, with `values` NULL: the indices of the points, from 0 */
} property;

/* Maximum number of properties that are not attributes. */
enum { PROPERTIES_OWN = 17 };

/* Lists the properties of the set, in a fixed order. `list` has PROPERTIES_OWN elements plus one per
 * attribute. Returns the number of properties. */
size_t property_list(const points *set, property *list);

/* The attribute with this name; NULL: there is none. */
const point_attribute *property_find_attribute(const point_attribute *list, size_t count, const char *name);

/* Sets attribute_missing, with the pointer of the member that names the attribute and the names of those in
 * the list. Returns false. */
bool property_refuse_missing(const point_attribute *list, size_t count, const char *pointer, const char *name,
                             error *e);

/* Whether an attribute is a velocity: a vector called v, vel or velocity. */
bool property_is_velocity(const point_attribute *a);

double property_value(const property *p, size_t point, int component);

#endif
