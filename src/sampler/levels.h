/* levels: how many particles to solve for, from the coarsest packing to the count that was asked for. */
#ifndef HEXAD_SAMPLER_LEVELS_H
#define HEXAD_SAMPLER_LEVELS_H

#include <stddef.h>
#include <stdint.h>

#include "field/field.h"
#include "surface/sizing_field.h"
#include "surface/surface.h"

#define LEVELS_MAX 12

/* Counts of the levels, coarsest first; the last is `count`. Returns how many, 1 to LEVELS_MAX: the coarsest
 * is still fine enough for the surface's curvature, for its smallest part, and for the grading (NULL: even).
 * Deterministic in the seed. */
int levels_plan(const field *f, const surface *scan, const sizing_field *sizing, size_t count, uint64_t seed,
                size_t out[LEVELS_MAX]);

/* Corrects a plan by the edges that the coarsest packing turned out to have, `on_boundary` of whose particles lie on
 * a boundary. A closed surface of Euler characteristic x has 3 (n - x) edges for n particles, an open one fewer by
 * its boundary particles, which double from level to level. Off by what refining would have to invent, a level
 * begins with as many defects. */
void levels_correct(size_t plan[LEVELS_MAX], int levels, size_t edges, size_t on_boundary);

#endif
