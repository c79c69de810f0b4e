// SPDX-License-Identifier: Apache-2.0
/* registration: the motion of a surface as a whole, estimated from points on the previous surface. It is the
 * similarity (translation, rotation, scale) that moves most of these points closest to the present surface.
 *
 * Method: Gauss-Newton on the distances F / |grad F| at the moved points, along the normals there, with
 * Cauchy weights, so that parts that appear or vanish have little influence. Points where the field is
 * undefined have none. For a symmetric surface, many motions fit equally well: the smallest of them is
 * chosen, so that a sphere does not rotate. World space and world units.
 */
#ifndef HEXAD_SAMPLING_SOLVER_REGISTRATION_H
#define HEXAD_SAMPLING_SOLVER_REGISTRATION_H

#include <stddef.h>

#include "base/core/threads.h"
#include "surface/field/field.h"

enum { REGISTRATION_UNKNOWNS = 7 };

typedef struct registration {
    vec3 centre;      /* fixed point of rotation and scale: the mean of the points */
    vec3 translation; /* translation of the centre */
    vec3 rotation;    /* axis times angle in radians */
    double growth;    /* logarithm of the scale */
} registration;

/* The image of the point x. */
vec3 registration_apply(const registration *m, vec3 x);

/* The image of the direction n. */
vec3 registration_turn(const registration *m, vec3 n);

/* The derivatives of `along` . registration_apply(m, x) by translation, rotation (three each) and growth. */
void registration_derive(const registration *m, vec3 x, vec3 along, double out[REGISTRATION_UNKNOWNS]);

/* Estimates the motion from `count` points on the previous surface with the given spacing. Returns the
 * identity if no motion explains most of the change. Deterministic for any number of threads. */
registration registration_find(const field *f, const vec3 *x, size_t count, double spacing, threads *pool);

#endif
