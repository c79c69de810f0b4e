// SPDX-License-Identifier: Apache-2.0
/* region: the part of a surface that lies in a box.
 *
 * Wraps a field: the same F, the cells that reach into the box, and a domain that ends at the box. Where the
 * surface meets a face of the box it is open and has a boundary. `extent`, the scale of curvature, remains
 * that of the whole surface: a part has the same spacing as in the whole.
 */
#ifndef HEXAD_SURFACE_FIELD_REGION_H
#define HEXAD_SURFACE_FIELD_REGION_H

#include <stddef.h>

#include "base/core/error.h"
#include "surface/field/field.h"

typedef struct region region;

/* `whole` is not owned and outlives the region. Errors: no_surface (no cell reaches into the box; the message
 * has the box), limit_memory. */
region *region_new(const field *whole, bbox box, error *e);
void region_free(region *r);

/* The field of the part, or `whole` itself if the box does not cut it. A face nearer than half a cell to the
 * surface counts as one that cuts it. */
const field *region_field(const region *r);

size_t region_bytes(const region *r);

#endif
