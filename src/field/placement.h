/* placement: a surface moved, turned, mirrored, scaled or sheared by an affine map. Wraps a field. */
#ifndef HEXAD_FIELD_PLACEMENT_H
#define HEXAD_FIELD_PLACEMENT_H

#include "base/error.h"
#include "field/field.h"

typedef struct placement placement;

/* World = `matrix` applied to the part's own space: 16 numbers, row-major, column vectors, last row 0 0 0 1,
 * invertible. `part` stays the caller's and outlives it. Errors: not_supported for an open part and a matrix
 * that turns it out of the world's axes, along which boundaries lie. */
placement *placement_new(const field *part, const double matrix[16], error *e);

/* The same for who asks for F and for places only: any matrix will do, and where the part is open is not told. */
placement *placement_new_view(const field *part, const double matrix[16]);
void placement_free(placement *p);
const field *placement_field(const placement *p);

/* A place of the world in the part's own space. */
vec3 placement_to_part(const placement *p, vec3 x);

/* How many times as long lengths are in the world, on the mean of all ways. */
double placement_scale(const placement *p);

/* The other way: a place, and a unit normal of the part. */
vec3 placement_to_world(const placement *p, vec3 x);
vec3 placement_turn_normal(const placement *p, vec3 normal);

#endif
