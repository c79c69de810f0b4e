/* solid: what unions, intersections and differences of solids with smooth surfaces hold, as a rule over the sides of these.
 *
 * A leaf is a smooth F with a matrix that places it: of a cube its six planes are leaves. Two rules say which places are
 * inside of the solid, and of the region in which its surface counts. The surface of leaf k counts at x where the first rule
 * depends on k's side there and the second holds. World space. Immutable once built; any thread may ask.
 */
#ifndef HEXAD_FIELD_SOLID_H
#define HEXAD_FIELD_SOLID_H

#include <stdint.h>

#include "field/analytic.h"
#include "field/field.h"

enum { SOLID_LEAVES = 64, SOLID_STEPS = 512 };

typedef struct solid_leaf {
    field base;           /* F of the leaf in the world */
    const field *field;   /* in its own space */
    double to_part[3][4]; /* from the world into that */
    analytic *owned;      /* the field, if it is a piece of a shape; else NULL */
} solid_leaf;

/* What pushes a leaf's side or joins the two on top. */
typedef struct solid_step {
    int16_t leaf; /* -1: any of the two, -2: both */
    bool inverted;
} solid_step;

typedef struct solid_rule {
    int count; /* 0: holds everywhere */
    solid_step step[SOLID_STEPS];
} solid_rule;

typedef struct solid {
    double size; /* of the whole, for what counts as equal */
    int count;
    solid_leaf leaf[SOLID_LEAVES];
    solid_rule inside, region;
    bool full; /* there were more leaves or steps than there is room for */
} solid;

solid *solid_new(double size);
void solid_free(solid *s);

/* Pushes a smooth field, which stays the caller's and outlives the solid, or what is outside of it. */
void solid_push_field(solid *s, solid_rule *rule, const field *f, const double to_world[3][4], bool inverted);

/* The same of a shape, by its smooth pieces. */
void solid_push_shape(solid *s, solid_rule *rule, const analytic_params *shape, const double to_world[3][4],
                      bool inverted);

/* Replaces the two rules on top by one that holds where any of them, or both, do. */
void solid_join(solid *s, solid_rule *rule, bool any);

/* ---- a built one; sides are bits, 1: inside of the leaf */

bool solid_holds(const solid_rule *rule, uint64_t sides);

/* About the distance of x from the leaf's surface, negative inside of it; far from where F is defined only the sign counts. */
double solid_distance(const solid *s, int leaf, vec3 x);

uint64_t solid_sides(const solid *s, vec3 x);

/* How the leaf's surface counts among these sides, its own left out: 0 not at all, 1 with the solid inside of the leaf, -1 with
 * the solid outside of it. */
int solid_surface(const solid *s, int leaf, uint64_t sides);

/* The leaf on whose surface that of the solid is at x or nearest to it, and on which side of that the solid is, as above. */
int solid_nearest(const solid *s, vec3 x, int *sign);

#endif
