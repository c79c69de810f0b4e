/* components: the connected parts of a surface, by its cells: two parts are separate if no two of their cells share a
 * face that the surface passes, by the signs at its corners; any face if cells differ in size, or are too far from the
 * origin for lattice positions. Each patch of a surface with patches is a part, whether it touches others or not; a cell
 * of several goes to one of them. */
#ifndef HEXAD_SURFACE_COMPONENTS_H
#define HEXAD_SURFACE_COMPONENTS_H

#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "field/field.h"

typedef struct components {
    size_t count;    /* of the parts */
    uint32_t *order; /* the cells, part after part, ascending within each; NULL: one part, as they are,
                      * and no patches */
    size_t *begin;   /* count + 1: where each part begins in the order */
} components;

/* Release also after failure. Errors: limit_memory, cancelled. Deterministic. */
bool components_find(const field *f, threads *pool, components *out, error *e);
void components_free(components *c);

#endif
