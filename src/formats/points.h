/* points: the plain arrays that make a finished point set, as every format writes them.
 * All arrays have `count` elements, in the order of the output; they belong to whoever built them.
 * World space and world units. See SPEC `points.ply` for the meaning of each. */
#ifndef HEXAD_FORMATS_POINTS_H
#define HEXAD_FORMATS_POINTS_H

#include <stddef.h>
#include <stdint.h>

#include "geometry/vec3.h"

/* What values are: how formats call them, and how transforms change them. */
typedef enum point_attribute_kind {
    POINT_ATTRIBUTE_FLOAT,
    POINT_ATTRIBUTE_INT,
    POINT_ATTRIBUTE_VECTOR, /* three components, as are the next two; a color may have four */
    POINT_ATTRIBUTE_NORMAL,
    POINT_ATTRIBUTE_COLOR,
    POINT_ATTRIBUTE_UV /* two */
} point_attribute_kind;

/* What points carry beside their own properties. */
typedef struct point_attribute {
    const char *name; /* letters, digits and _ */
    point_attribute_kind kind;
    int components;       /* 1 to 4 */
    const double *values; /* so many a point, point after point; finite */
} point_attribute;

typedef struct points {
    size_t count;
    const vec3 *position;
    const vec3 *normal;  /* unit, out of the solid */
    const double *kappa; /* sqrt(kappa1^2 + kappa2^2), 1/world unit */
    const double *kappa1;
    const double *kappa2;
    const double
        *alpha; /* repulsion amplitude of (13); 1 where none is asked for and cells are not evened out */
    const double *energy;        /* E_i, the particle's full sum */
    const double *spacing;       /* requested spacing at the point */
    const double *spacing_local; /* achieved spacing, sqrt(2 a / sqrt 3) */
    const double *degree;        /* how many neighbours each has; or NULL */
    const double *kappa_scale;   /* curvature over a distance; or NULL */
    const uint32_t *id;          /* of coherent sequences, with velocity; or NULL, both */
    const vec3 *velocity;        /* world units per frame */
    size_t attribute_count;
    const point_attribute *attributes;
    const vec3 *color;     /* red, green and blue, 0 to 1; or NULL */
    const double *uv;      /* texture coordinates, two a point; or NULL */
    size_t triangle_count; /* of a mesh whose vertices they are; 0: there is none */
    const uint32_t (*triangle)[3];
    const int64_t (
        *triangle_labels)[2]; /* of each, where it parts two labels: its normal points from the first to the
                                          * second; or NULL */
} points;

#endif
