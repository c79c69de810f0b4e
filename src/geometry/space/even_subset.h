// SPDX-License-Identifier: Apache-2.0
/* even_subset: some of many points on a surface, at distances that are even for their number.
 *
 * Points are considered in their order. One is chosen if no chosen point on the same side of the surface is nearer than
 * its size times the reach. So no two chosen points are nearer than that, and no considered point is farther from all of
 * them: discs of this radius overlap and leave no gaps. Any thread.
 */
#ifndef HEXAD_GEOMETRY_SPACE_EVEN_SUBSET_H
#define HEXAD_GEOMETRY_SPACE_EVEN_SUBSET_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "geometry/space/vec3.h"

typedef struct even_subset_points {
    size_t count;
    const vec3 *position, *normal; /* normals point to the side of a wall that a point belongs to */
    double spacing;                /* distance of neighbours, for a size of 1 */
    const double *size; /* per point; NULL: 1. It differs by less than a quarter within the reach */
} even_subset_points;

typedef struct even_subset {
    uint32_t *chosen; /* `count` indices, ascending; the caller frees them */
    size_t count;
    double reach; /* of a point of size 1 */
} even_subset;

/* Chooses about `wanted` of more points, at most 2 * wanted. Of more than 4 * wanted points every k-th is considered.
 * False: limit_memory. */
bool even_subset_choose(const even_subset_points *p, size_t wanted, even_subset *s, error *e);

#endif
