/* combination: the union, intersection or difference of solids, as the least or greatest of their fields.
 *
 * Each part's F is divided by its mean slope on its surface, so that fields of different units may be
 * compared; where two are equal there is a sharp edge. A part that is not defined far from its surface counts
 * by its side there. Cells are those of a grid of its own, looked for wherever a part has cells and at least as fine as
 * that part's there, and than half of a wall or slit between two parts.
 */
#ifndef HEXAD_FIELD_COMBINATION_H
#define HEXAD_FIELD_COMBINATION_H

#include <stddef.h>

#include "base/error.h"
#include "base/threads.h"
#include "field/field.h"

typedef struct combination combination;

typedef enum combination_kind {
    COMBINATION_UNION,
    COMBINATION_INTERSECTION,
    COMBINATION_DIFFERENCE /* of the first and all others */
} combination_kind;

/* `parts`, of which there is at least one, stay the caller's and outlive it; the array need not. `wall_levels`: how often cells are
 * halved at most in walls and slits between two parts, unless a part is open or they would be too many for `memory`, in bytes; 0: such
 * are not looked for. More often where nothing would have cells otherwise. A combination that is part of another makes that one's
 * cells as small as its own everywhere that it has cells. Errors: no_surface, nothing is left; limit_memory, also where all that
 * is left is thinner than cells can be; not_supported when an open part's boundary would lie within the combination; and those of
 * cell_grid_search. */
combination *combination_new(combination_kind kind, const field *const *parts, size_t count, int wall_levels,
                             size_t memory, threads *pool, error *e);
void combination_free(combination *c);
const field *combination_field(const combination *c);

/* The share of its area, about, in walls and slits thinner than a cell, which may have no cells; *area, unless NULL: the area,
 * which is up to half as much again. Both 0 where walls are not looked for. */
double combination_missing(const combination *c, double *area);
size_t combination_bytes(const combination *c);

#endif
