/* coverage: whether every place of a surface has a point near it.
 *
 * The places are above the middles of the triangles in which the surface passes its cells. In an ideal packing the farthest is
 * .58 spacings from the nearest point, beside a vacancy 1. Distances are taken in space: where sheets are closer than
 * the spacing a place may be near a point of the other sheet.
 */
#ifndef HEXAD_SOLVER_COVERAGE_H
#define HEXAD_SOLVER_COVERAGE_H

#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "surface/surface.h"

/* What coverage_measure tells of: the patches, or the surface as a whole. */
size_t coverage_parts(const surface *scan);

/* Raises `farthest` of each of coverage_parts to the largest distance of a place from the nearest of `count` > 0 points, of whatever
 * patch, over the spacing requested there, > 0; what lies below it takes little time. Errors: limit_memory, cancelled. Deterministic for any number of threads. */
bool coverage_measure(const surface *scan, const vec3 *position, const double *spacing, size_t count,
                      threads *pool, double *farthest, error *e);

/* Places of a surface, and the patch of each: 0 without patches. */
typedef struct coverage_places {
    vec3 *place;
    uint32_t *patch;
    size_t count, room;
} coverage_places;

/* All places that are farther from all points than `bare` > 0, over the spacing there. One thread. Error: limit_memory. */
bool coverage_find_bare(const surface *scan, const vec3 *position, const double *spacing, size_t count,
                        double bare, coverage_places *out, error *e);
void coverage_places_free(coverage_places *p); /* a zeroed one will do */

#endif
