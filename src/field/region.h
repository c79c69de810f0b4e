/* region: the part of a surface that lies in a box.
 *
 * Wraps a field: the same F, the cells that reach into the box, and a domain that ends at it. Where the
 * surface meets a face of the box it is open and has a boundary there. The scale of curvature, `extent`, stays
 * that of the whole surface: a part of it is graded as it is in the whole.
 */
#ifndef HEXAD_FIELD_REGION_H
#define HEXAD_FIELD_REGION_H

#include <stddef.h>

#include "base/error.h"
#include "field/field.h"

typedef struct region region;

/* `whole` stays the caller's and outlives the region. Errors: no_surface when no cell reaches into the box,
 * which is named; limit_memory. */
region *region_new(const field *whole, bbox box, error *e);
void region_free(region *r);

/* The field of the part; that of the whole itself where the box cuts nothing off. A face that passes the
 * surface at less than half a cell counts as one that cuts it. */
const field *region_field(const region *r);

size_t region_bytes(const region *r);

#endif
