// SPDX-License-Identifier: Apache-2.0
/* thin_walls: walls of a dense volume that are thinner than its voxels, found slice by slice.
 *
 * Along the lines of samples the surface crosses each edge whose ends have different signs. A wall that no sample lies in
 * leaves a kink instead: on both sides of an edge F falls towards the isovalue, and each side, continued by the parabola
 * of its three samples, is beyond the isovalue where they meet. Parabolas distinguish the kink from a smooth minimum. The
 * numbers of crossings along lines of all three axes are proportional to area (Crofton). Index space; one thread. */
#ifndef HEXAD_SURFACE_VOLUME_THIN_WALLS_H
#define HEXAD_SURFACE_VOLUME_THIN_WALLS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"

/* An edge between a sample and the next one along an axis. */
typedef struct thin_walls_edge {
    int32_t at[3], axis;
} thin_walls_edge;

typedef struct thin_walls_found {
    uint64_t crossed;      /* edges with a change of sign */
    uint64_t thin;         /* of these: on walls with one sample that are thinner than two voxels */
    uint64_t kinks;        /* edges that a wall or a gap without a sample crosses: twice */
    thin_walls_edge *kink; /* of these: all, or THIN_WALLS_KEPT of them chosen at random */
} thin_walls_found;

/* Maximum number of kinks that are stored. */
enum { THIN_WALLS_KEPT = 65536 };

/* Maximum share of area lost between samples of a result that represents the surface. */
#define THIN_WALLS_MOST_LOST 0.02

typedef struct thin_walls_search thin_walls_search;

/* Bytes of a search in slices of this size. */
size_t thin_walls_bytes(int64_t width, int64_t height);

thin_walls_search *thin_walls_begin(int64_t width, int64_t height, error *e); /* error: limit_memory */

/* Adds the next slice along the third axis: value - isovalue is -F. NaN, and values that are no_data or its float, are
 * outside and end the lines there. */
void thin_walls_add(thin_walls_search *s, const double *values, double isovalue, double no_data);

/* The number of kinks that are stored. */
static inline size_t thin_walls_kept(const thin_walls_found *f)
{
    return f->kinks < THIN_WALLS_KEPT ? (size_t)f->kinks : THIN_WALLS_KEPT;
}

/* Takes the result, which thin_walls_free releases. */
thin_walls_found thin_walls_take(thin_walls_search *s);
void thin_walls_end(thin_walls_search *s); /* accepts NULL */
void thin_walls_free(thin_walls_found *f); /* accepts a zeroed object */

#endif
