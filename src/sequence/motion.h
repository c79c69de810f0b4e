/* motion: the motion of a surface as a whole, told from points that lay on it before: the similarity
 * (translation, rotation, scale) that brings most of them closest to the surface as it is now.
 *
 * Gauss-Newton on the distances F / |grad F| at the moved points, along the normals there, with the weights
 * of Cauchy, so that parts that appear or vanish have no say; nor has a point where the field is not defined.
 * Of all motions that explain the surface equally well, which symmetric ones have many of, it is the
 * smallest: a sphere does not spin. World space and world units. */
#ifndef HEXAD_SEQUENCE_MOTION_H
#define HEXAD_SEQUENCE_MOTION_H

#include <stddef.h>

#include "base/threads.h"
#include "field/field.h"

enum { MOTION_UNKNOWNS = 7 };

typedef struct motion {
    vec3 centre;      /* that it turns and grows about: the mean of the points */
    vec3 translation; /* of the centre */
    vec3 rotation;    /* about its direction by its length, radians */
    double growth;    /* logarithm of the scale */
} motion;

/* Where x comes to lie. */
vec3 motion_apply(const motion *m, vec3 x);

/* Where the normal n at any point comes to point. */
vec3 motion_turn(const motion *m, vec3 n);

/* The derivatives of `along` . motion_apply(m, x) by translation, rotation (three each) and growth. */
void motion_derive(const motion *m, vec3 x, vec3 along, double out[MOTION_UNKNOWNS]);

/* The motion of `count` points that lay on the surface, about `spacing` from each other. The identity when
 * none explains most of it. Deterministic for any number of threads. */
motion motion_find(const field *f, const vec3 *x, size_t count, double spacing, threads *pool);

#endif
