/* registration: the motion of a surface as a whole, estimated from points that lay on the surface before. It is the
 * similarity (translation, rotation, scale) that brings most of these points closest to the surface as it is now.
 *
 * Method: Gauss-Newton on the distances F / |grad F| at the moved points, along the normals there, with Cauchy's
 * weights, so that parts that appear or vanish do not count. A point where the field is not defined does not count
 * either. A symmetric surface has many motions that fit equally well: the smallest of them is taken, so that a sphere
 * does not spin. World space and world units. */
#ifndef HEXAD_SEQUENCE_REGISTRATION_H
#define HEXAD_SEQUENCE_REGISTRATION_H

#include <stddef.h>

#include "base/threads.h"
#include "field/field.h"

enum { REGISTRATION_UNKNOWNS = 7 };

typedef struct registration {
    vec3 centre;      /* that it turns and grows about: the mean of the points */
    vec3 translation; /* of the centre */
    vec3 rotation;    /* about its direction by its length, radians */
    double growth;    /* logarithm of the scale */
} registration;

/* Where x comes to lie. */
vec3 registration_apply(const registration *m, vec3 x);

/* Where the normal n at any point comes to point. */
vec3 registration_turn(const registration *m, vec3 n);

/* The derivatives of `along` . registration_apply(m, x) by translation, rotation (three each) and growth. */
void registration_derive(const registration *m, vec3 x, vec3 along, double out[REGISTRATION_UNKNOWNS]);

/* Estimates the motion from `count` points that lay on the surface before, about `spacing` from each other. Returns
 * the identity when no motion explains most of the change. Deterministic for any number of threads. */
registration registration_find(const field *f, const vec3 *x, size_t count, double spacing, threads *pool);

#endif
