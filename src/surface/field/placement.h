// SPDX-License-Identifier: Apache-2.0
/* placement: a surface moved, turned, mirrored, scaled or sheared by an affine map. Wraps a field. */
#ifndef HEXAD_SURFACE_FIELD_PLACEMENT_H
#define HEXAD_SURFACE_FIELD_PLACEMENT_H

#include "base/core/error.h"
#include "surface/field/field.h"

typedef struct placement placement;

/* World = `matrix` applied to the part's own space: 16 numbers, row-major, column vectors, last row 0 0 0 1,
 * invertible. `part` is not owned and outlives the placement. Error: not_supported (the part is open and the
 * matrix does not map axes to axes: boundaries lie in planes across the axes). */
placement *placement_new(const field *part, const double matrix[16], error *e);

/* A placement for sampling only, with any matrix and no information on boundaries. Cannot fail. */
placement *placement_new_view(const field *part, const double matrix[16]);
void placement_free(placement *p);
const field *placement_field(const placement *p);

/* Maps a place from the world to the part's own space. */
vec3 placement_to_part(const placement *p, vec3 x);

/* The mean factor by which lengths grow from the part's own space to the world. */
double placement_scale(const placement *p);

/* Maps a place, and a unit normal of the part, to the world. */
vec3 placement_to_world(const placement *p, vec3 x);
vec3 placement_turn_normal(const placement *p, vec3 normal);
/* Maps a unit normal of the world to the part. */
vec3 placement_turn_normal_to_part(const placement *p, vec3 normal);
/* Changes the derivatives of a sample of the part to those in the world. */
void placement_turn_sample(const placement *p, field_sample *s);

#endif
