// SPDX-License-Identifier: Apache-2.0
/* bbox: an axis-aligned box, min <= max on each axis; an empty box has min = +inf, max = -inf. Pure
 * functions, any thread.
 */
#ifndef HEXAD_GEOMETRY_SPACE_BBOX_H
#define HEXAD_GEOMETRY_SPACE_BBOX_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/threads.h"
#include "geometry/space/vec3.h"

enum { BBOX_FACES = 6 };

typedef struct bbox {
    vec3 min, max;
} bbox;

static inline bbox bbox_empty(void)
{
    return (bbox){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
}

/* Without fmin, which is a function call: this runs for every point of a surface. */
static inline bbox bbox_include(bbox b, vec3 p)
{
    return (bbox){
        {p.x < b.min.x ? p.x : b.min.x, p.y < b.min.y ? p.y : b.min.y, p.z < b.min.z ? p.z : b.min.z},
        {p.x > b.max.x ? p.x : b.max.x, p.y > b.max.y ? p.y : b.max.y, p.z > b.max.z ? p.z : b.max.z}};
}

/* The bounding box of both. Without fmin. */
static inline bbox bbox_unite(bbox a, bbox b)
{
    return (bbox){{a.min.x < b.min.x ? a.min.x : b.min.x, a.min.y < b.min.y ? a.min.y : b.min.y,
                   a.min.z < b.min.z ? a.min.z : b.min.z},
                  {a.max.x > b.max.x ? a.max.x : b.max.x, a.max.y > b.max.y ? a.max.y : b.max.y,
                   a.max.z > b.max.z ? a.max.z : b.max.z}};
}

static inline bbox bbox_move(bbox b, vec3 by)
{
    return (bbox){vec3_add(b.min, by), vec3_add(b.max, by)};
}

/* The intersection of both; min > max on some axis if it is empty. */
static inline bbox bbox_common(bbox a, bbox b)
{
    return (bbox){{fmax(a.min.x, b.min.x), fmax(a.min.y, b.min.y), fmax(a.min.z, b.min.z)},
                  {fmin(a.max.x, b.max.x), fmin(a.max.y, b.max.y), fmin(a.max.z, b.max.z)}};
}

/* Whether the intersection has a volume. */
static inline bool bbox_overlap(bbox a, bbox b)
{
    bbox c = bbox_common(a, b);
    return c.min.x < c.max.x && c.min.y < c.max.y && c.min.z < c.max.z;
}

/* Whether they have a common point; touching faces count. */
static inline bool bbox_meet(const bbox *a, const bbox *b)
{
    return a->min.x <= b->max.x && b->min.x <= a->max.x && a->min.y <= b->max.y && b->min.y <= a->max.y &&
           a->min.z <= b->max.z && b->min.z <= a->max.z;
}

static inline bool bbox_contains(bbox b, vec3 p)
{
    return p.x >= b.min.x && p.x <= b.max.x && p.y >= b.min.y && p.y <= b.max.y && p.z >= b.min.z &&
           p.z <= b.max.z;
}

static inline vec3 bbox_size(bbox b)
{
    return vec3_sub(b.max, b.min);
}
/* The box with each face moved outwards by `margin`, inwards if negative. */
static inline bbox bbox_grow(bbox b, double margin)
{
    vec3 m = {margin, margin, margin};
    return (bbox){vec3_sub(b.min, m), vec3_add(b.max, m)};
}

static inline double bbox_longest(bbox b)
{
    vec3 s = bbox_size(b);
    return fmax(s.x, fmax(s.y, s.z));
}

/* The bounding box of all points, also if the pool was stopped; an empty box without points. */
bbox bbox_of_points(const vec3 *points, size_t count, threads *pool);
/* bbox_of_points of the points whose indices are in the list. */
bbox bbox_of_corners(const vec3 *points, const uint32_t *list, size_t count, threads *pool);

#endif
