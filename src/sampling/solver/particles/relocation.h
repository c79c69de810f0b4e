// SPDX-License-Identifier: Apache-2.0
/* relocation: pairs over-dense points with gaps in coverage. If the spacing does not resolve the surface,
 * relaxation cannot remove either of them: no continuous path of decreasing energy leads from an over-dense
 * place to a gap.
 *
 * A point is over-dense if another point is within RELOCATION_DENSE spacings. A place is a gap if no point is
 * within RELOCATION_GAP spacings. The caller may set other distances. The densest point goes to the largest
 * gap, the second densest to the second largest, and so on, as long as the gap is farther from its nearest
 * point than the moved point is from its own nearest point. Only one of several over-dense points near each
 * other moves, and only one of several gaps near each other is filled. Deterministic for any number of
 * threads. World space.
 */
#ifndef HEXAD_SAMPLING_SOLVER_PARTICLES_RELOCATION_H
#define HEXAD_SAMPLING_SOLVER_PARTICLES_RELOCATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/vec3.h"

/* Distances in spacings. In an ideal packing, points are at least 0.8 apart, and every place is within
 * 0.58 of a point. */
#define RELOCATION_DENSE 0.72
#define RELOCATION_GAP 0.65

typedef struct relocation {
    uint32_t point, place;
} relocation;

typedef struct relocation_input {
    const vec3 *point;
    const double *size; /* per point: its spacing over h */
    size_t count;       /* > 0 */
    double h;
    const vec3 *place; /* candidate positions on the surface or near it */
    size_t places;     /* > 0 */
    /* per place, in and out: a point to test first, which only saves time; a value that is not an index is
     * ignored. Receives the nearest point, or a near point that shows that the place is not a gap. */
    uint32_t *near;
    double gap;            /* minimum distance of a place from all points, in spacings; 0: RELOCATION_GAP */
    const bool *immovable; /* per point: it must not move; NULL: all may */
    /* a point with another within this distance is over-dense, in spacings; 0: RELOCATION_DENSE */
    double dense;
} relocation_input;

/* Computes *moves relocations, each point and each place at most once. Free *out. Error: limit_memory. */
bool relocation_choose(const relocation_input *in, threads *pool, relocation **out, size_t *moves, error *e);

#endif
