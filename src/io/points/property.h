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

/* The properties that are not attributes, in the order of property_list. */
typedef enum property_own {
    PROPERTY_OWN_POSITION,
    PROPERTY_OWN_NORMAL,
    PROPERTY_OWN_COLOR,
    PROPERTY_OWN_UV,
    PROPERTY_OWN_RADIUS,
    PROPERTY_OWN_KAPPA,
    PROPERTY_OWN_KAPPA1,
    PROPERTY_OWN_KAPPA2,
    PROPERTY_OWN_ALPHA,
    PROPERTY_OWN_ENERGY,
    PROPERTY_OWN_SPACING,
    PROPERTY_OWN_SPACING_LOCAL,
    PROPERTY_OWN_KAPPA_SCALE,
    PROPERTY_OWN_ORIENT,
    PROPERTY_OWN_ID,
    PROPERTY_OWN_VELOCITY,
    PROPERTIES_OWN
} property_own;

typedef struct property_array {
    const char *name;
    property_role role;
    int components;
    size_t member; /* offset of its pointer in struct points, to doubles; of ids to uint32_t */
    double scale;  /* value = scale * number */
} property_array;

extern const property_array property_arrays[PROPERTIES_OWN];

/* The array of a property; NULL: the set does not have it. */
const void *property_array_of(const points *set, property_own own);

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
