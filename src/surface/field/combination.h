// SPDX-License-Identifier: Apache-2.0
/* combination: the union, intersection or difference of solids, as the minimum or maximum of their fields.
 *
 * F of each part is divided by its mean slope on its surface, so that fields of different units are
 * comparable. There is a sharp edge where two are equal. A part that is not defined far from its surface
 * contributes its side there. The combination has a grid of its own. It is searched wherever a part has
 * cells. Its cells are at most as large as the part's, and at most half the thickness of a wall or gap
 * between two parts. World units. Immutable after construction, any thread.
 */
#ifndef HEXAD_SURFACE_FIELD_COMBINATION_H
#define HEXAD_SURFACE_FIELD_COMBINATION_H

#include <stddef.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/field/field.h"

typedef struct combination combination;

typedef enum combination_kind {
    COMBINATION_UNION,
    COMBINATION_INTERSECTION,
    COMBINATION_DIFFERENCE /* the first part minus all others */
} combination_kind;

/* `parts`: at least one; the fields are not owned and outlive the combination, the array need not.
 * `wall_levels`: maximum number of times that cells are halved in walls and gaps between two parts; 0: walls
 * are not detected. Cells are not halved if a part is open or if they would exceed `memory`, bytes. They are
 * halved more often if the result would have no cells otherwise. If a combination is a part of another one,
 * the cells of the other one are as small as its smallest cells, wherever it has cells. `spacing`: of the
 * points that will sample it, world units; 0: it follows from their number, `points`. If they are few, the
 * largest cells are larger, by up to 2. Both 0: unknown. Errors: no_surface (nothing is left), limit_memory
 * (also if all that is left is thinner than the smallest cells), not_supported (the boundary of an open part
 * would lie inside the combination), and those of cell_grid_search. */
combination *combination_new(combination_kind kind, const field *const *parts, size_t count, int wall_levels,
                             double spacing, double points, size_t memory, threads *pool, error *e);
void combination_free(combination *c);
const field *combination_field(const combination *c);

/* The approximate fraction of the area in walls and gaps thinner than a cell, which may have no cells. *area
 * (or NULL): the area, overestimated by up to one half. Both are 0 if walls are not detected. */
double combination_missing(const combination *c, double *area);
size_t combination_bytes(const combination *c);

#endif
