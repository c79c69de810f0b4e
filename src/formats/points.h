/* points: the plain arrays that make a finished point set, as every format writes them.
 * All arrays have `count` elements, in the order of the output; they belong to whoever built them.
 * World space and world units. See SPEC `points.ply` for the meaning of each. */
#ifndef HEXAD_FORMATS_POINTS_H
#define HEXAD_FORMATS_POINTS_H

#include <stddef.h>
#include <stdint.h>

#include "geometry/vec3.h"

typedef struct points {
    size_t count;
    const vec3 *position;
    const vec3 *normal;  /* unit, out of the solid */
    const double *kappa; /* sqrt(kappa1^2 + kappa2^2), 1/world unit */
    const double *kappa1;
    const double *kappa2;
    const double *alpha;         /* repulsion amplitude of (13); 1 where there is no grading */
    const double *energy;        /* E_i, the particle's full sum */
    const double *spacing;       /* requested spacing at the point */
    const double *spacing_local; /* achieved spacing, sqrt(2 a / sqrt 3) */
    const double *degree;        /* how many neighbours each has; or NULL */
    const double *kappa_scale;   /* curvature over a distance; or NULL */
    const uint32_t *id;          /* of coherent sequences, with velocity; or NULL, both */
    const vec3 *velocity;        /* world units per frame */
    size_t triangle_count;       /* of a mesh whose vertices they are; 0: there is none */
    const uint32_t (*triangle)[3];
} points;

#endif
