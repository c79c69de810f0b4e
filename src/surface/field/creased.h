// SPDX-License-Identifier: Apache-2.0
/* creased: the surface of a solid as patches, one for each leaf that contributes to it. Patches meet in
 * creases and end at the faces of a region.
 *
 * The zero set of each leaf is triangulated in grid cells. Triangles are split where another leaf changes its
 * side, so that each triangle belongs to one patch and the sides between patches are the creases. World
 * units. Immutable after construction, any thread.
 */
#ifndef HEXAD_SURFACE_FIELD_CREASED_H
#define HEXAD_SURFACE_FIELD_CREASED_H

#include "base/core/error.h"
#include "surface/field/patches.h"
#include "surface/field/solid.h"

typedef struct creased creased;

/* Takes ownership of the solid, also on failure. `whole`: a field of the same surface, whose cells locate it.
 * It may be larger if a region cuts it; `box` bounds the part that is kept. Errors: no_surface,
 * limit_memory. */
creased *creased_new(solid *s, const field *whole, bbox box, error *e);
void creased_free(creased *c);
const field *creased_field(const creased *c);
size_t creased_bytes(const creased *c);

#endif
