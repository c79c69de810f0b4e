// SPDX-License-Identifier: Apache-2.0
/* solid: unions, intersections and differences of smooth solids, as Boolean functions of the sides of their
 * surfaces.
 *
 * A leaf is a smooth F with a matrix that places it; a cube has six planes as leaves. One rule determines
 * which places are inside the solid, a second one the region in which its surface counts. Leaf k contributes
 * to the surface at x if the first rule depends on the side of k there and the second rule holds. World
 * space. Immutable after construction; any thread.
 */
#ifndef HEXAD_SURFACE_FIELD_SOLID_H
#define HEXAD_SURFACE_FIELD_SOLID_H

#include <stdint.h>

#include "surface/field/analytic.h"
#include "surface/field/field.h"

enum { SOLID_LEAVES = 64, SOLID_STEPS = 512 };

typedef struct solid_leaf {
    field base;           /* F of the leaf in world space */
    const field *field;   /* F in the leaf's own space */
    double to_part[3][4]; /* from world space to the leaf's own space */
    analytic *owned;      /* the field, if the leaf owns it (a face of a shape); or NULL */
} solid_leaf;

/* A step of a stack machine: pushes the side of a leaf, or joins the two values on top. */
typedef struct solid_step {
    int16_t leaf; /* >= 0: leaf to push; -1: or; -2: and */
    bool inverted;
} solid_step;

typedef struct solid_rule {
    int count; /* 0: holds everywhere */
    solid_step step[SOLID_STEPS];
} solid_rule;

typedef struct solid {
    double size; /* longest side of the whole, world units; tolerances are relative to it */
    int count;
    solid_leaf leaf[SOLID_LEAVES];
    solid_rule inside, region;
    bool full; /* the limits on leaves or steps were exceeded; the solid is not usable */
} solid;

solid *solid_new(double size);
void solid_free(solid *s);

/* Pushes a smooth field or, if `inverted`, its complement. `f` is not owned and outlives the solid. */
void solid_push_field(solid *s, solid_rule *rule, const field *f, const double to_world[3][4], bool inverted);

/* Pushes a shape, as the intersection of its smooth faces. */
void solid_push_shape(solid *s, solid_rule *rule, const analytic_params *shape, const double to_world[3][4],
                      bool inverted);

/* Replaces the two values on top by their disjunction (`any`) or conjunction. */
void solid_join(solid *s, solid_rule *rule, bool any);

/* ---- queries; `sides` has bit k set for places inside leaf k */

bool solid_holds(const solid_rule *rule, uint64_t sides);

/* The approximate distance of x from the surface of the leaf, negative inside, world units. Where F is not
 * defined only the sign is valid. */
double solid_distance(const solid *s, int leaf, vec3 x);

uint64_t solid_sides(const solid *s, vec3 x);

/* Whether the leaf's surface belongs to the surface of the solid at a place with these sides; the side of the
 * leaf itself is ignored. 0: no; 1: yes, and the solid is inside the leaf; -1: yes, and the solid is
 * outside the leaf. */
int solid_surface(const solid *s, int leaf, uint64_t sides);

/* The leaf whose part of the surface of the solid is closest to x. *sign: as solid_surface returns it. */
int solid_nearest(const solid *s, vec3 x, int *sign);

#endif
