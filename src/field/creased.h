/* creased: the surface of a solid as patches, one for each leaf that it lies on, which meet in creases and end at the faces of
 * a region.
 *
 * The leaves are cut into triangles within cells, and each triangle where another leaf changes its side there, so that each is
 * of one patch and their sides are the creases.
 */
#ifndef HEXAD_FIELD_CREASED_H
#define HEXAD_FIELD_CREASED_H

#include "base/error.h"
#include "field/patches.h"
#include "field/solid.h"

typedef struct creased creased;

/* Takes over the solid, also on failure. `whole` is a field of the same surface, whose cells tell where it is; it may be more
 * where a region cuts it, of which `box` is a bound. Errors: no_surface, limit_memory. */
creased *creased_new(solid *s, const field *whole, bbox box, error *e);
void creased_free(creased *c);
const field *creased_field(const creased *c);
size_t creased_bytes(const creased *c);

#endif
