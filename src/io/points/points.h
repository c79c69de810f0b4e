// SPDX-License-Identifier: Apache-2.0
/* points: a finished point set as plain arrays, which every format writes. All arrays have `count` elements,
 * in the order of output; the creator owns them. World space and world units. doc/report.md and
 * doc/formats.md describe the properties.
 */
#ifndef HEXAD_IO_POINTS_POINTS_H
#define HEXAD_IO_POINTS_POINTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "geometry/space/vec3.h"

/* The kind of an attribute, which determines its name in formats and its transformation. */
typedef enum point_attribute_kind {
    POINT_ATTRIBUTE_FLOAT,
    POINT_ATTRIBUTE_INT,
    POINT_ATTRIBUTE_VECTOR, /* three components, as the next two kinds; a color may have four */
    POINT_ATTRIBUTE_NORMAL,
    POINT_ATTRIBUTE_COLOR,
    POINT_ATTRIBUTE_UV /* two components */
} point_attribute_kind;

/* The name of the attribute that has the values of points.kappa_defined. */
#define POINTS_KAPPA_DEFINED "kappa_defined"

/* An attribute of points, in addition to their own properties. */
typedef struct point_attribute {
    const char *name; /* letters, digits and _ */
    point_attribute_kind kind;
    int components;       /* 1 to 4 */
    const double *values; /* `components` per point, in the order of points; finite */
    bool is_double;       /* real numbers that formats write as doubles where they have doubles */
} point_attribute;

typedef struct points {
    size_t count;
    const vec3 *position;
    const vec3 *normal;  /* unit, pointing out of the solid */
    const double *kappa; /* sqrt(kappa1^2 + kappa2^2), 1/world unit */
    const double *kappa1;
    const double *kappa2;
    const double *kappa_defined; /* 0: the curvature is undefined; NULL: it is defined at all points */
    const double *alpha;         /* repulsion amplitude of (13); 1 without alpha and equalised areas */
    const double *energy;        /* E_i, the sum over all neighbours */
    const double *spacing;       /* requested spacing at the point */
    bool is_graded;              /* the requested spacing varies by a grading or amplitudes */
    const double *spacing_local; /* achieved spacing, sqrt(2 a / sqrt 3) */
    const double *degree;        /* number of Voronoi neighbours; or NULL */
    const double *kappa_scale;   /* curvature averaged over a distance; or NULL */
    const uint32_t *id;          /* in coherent sequences; otherwise NULL, as `velocity` */
    const vec3 *velocity;        /* world units per frame */
    size_t attribute_count;
    const point_attribute *attributes;
    const double *orient;  /* unit quaternions x y z w, see orientation.h; or NULL */
    const vec3 *color;     /* sRGB, 0 to 1; or NULL */
    const double *uv;      /* texture coordinates, two per point; or NULL */
    size_t triangle_count; /* of the mesh whose vertices are the points; 0: no mesh */
    const uint32_t (*triangle)[3];
    /* labels on both sides of each triangle, whose normal points from the first to the second; or NULL */
    const int64_t (*triangle_labels)[2];
} points;

#endif
