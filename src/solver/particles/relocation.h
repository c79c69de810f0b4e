/* relocation: points that crowd go to bare places. A descent leaves such where the spacing does not resolve a surface: no
 * point finds the way from one to the other.
 *
 * A point is crowded when another is within RELOCATION_CROWDED of the spacing, a place bare when no point is within
 * RELOCATION_BARE, or within the distances that are asked for. The most crowded point goes to the barest place, and so on, as long as it is farther from its nearest
 * point there. Of two that are near each other one goes; two places that are near each other do not both get a point.
 * Deterministic for any number of threads.
 */
#ifndef HEXAD_SOLVER_RELOCATION_H
#define HEXAD_SOLVER_RELOCATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/vec3.h"

/* An ideal packing has no two points within .8 of the spacing, and no place beyond .58. */
#define RELOCATION_CROWDED 0.72
#define RELOCATION_BARE 0.65

typedef struct relocation {
    uint32_t point, place;
} relocation;

typedef struct relocation_input {
    const vec3 *point;
    const double *size; /* of each: its spacing is h times this */
    size_t count;       /* > 0 */
    double h;
    const vec3 *place; /* on the surface, or near it */
    size_t places;     /* > 0 */
    size_t list_limit; /* bytes that lists of who is near may take */
    uint32_t *near;    /* of each place the point found last, any number at first: it is looked at first */
    double bare; /* how far from all points a place is that gets one, over the spacing; 0: RELOCATION_BARE */
    const bool *held; /* of each point whether it stays; NULL: none does */
    double crowded;   /* how near another one is of a point that crowds; 0: RELOCATION_CROWDED */
} relocation_input;

/* *out, to be freed, receives *moves of them, no point and no place twice. Error: limit_memory. */
bool relocation_choose(const relocation_input *in, threads *pool, relocation **out, size_t *moves, error *e);

#endif
