// SPDX-License-Identifier: Apache-2.0
/* components: the connected parts of a surface, as sets of cells. Two cells are connected if they share a
 * face that the surface crosses, by the signs of F at its corners. If cells differ in size, or are too far
 * from the origin for lattice positions, any shared face connects them. If the surface has patches, each
 * patch is a part, also if it touches others; a cell with several patches belongs to one of them.
 */
#ifndef HEXAD_SURFACE_SCAN_COMPONENTS_H
#define HEXAD_SURFACE_SCAN_COMPONENTS_H

#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/field/field.h"

typedef struct components {
    size_t count; /* of parts */
    /* the cells, part after part, ascending within each part; NULL: cells in their own order, as those of meshes */
    uint32_t *order;
    /* count + 1 values: the start of each part in that order; NULL: one part, no patches */
    size_t *begin;
} components;

/* Free *out also after failure. Errors: limit_memory, cancelled. Deterministic. */
bool components_find(const field *f, threads *pool, components *out, error *e);
void components_free(components *c);

#endif
