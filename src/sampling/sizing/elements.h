// SPDX-License-Identifier: Apache-2.0
/* elements: a coarse description of the surface: mean position, normal and area of its part in each cube. A
 * cube has a separate element for each of six directions of the normal, so that opposite walls are separate,
 * and for each patch. World units. Immutable after construction, any thread.
 */
#ifndef HEXAD_SAMPLING_SIZING_ELEMENTS_H
#define HEXAD_SAMPLING_SIZING_ELEMENTS_H

#include "base/core/error.h"
#include "geometry/space/block_map.h"
#include "sampling/sizing/cell_samples.h"
#include "surface/scan/surface.h"

/* Minimum edge of a cube over that of the surface's cells: smaller cubes would be skipped. */
#define ELEMENTS_LEAST_EDGE 1.25

typedef struct element {
    double area;
    vec3 position, normal; /* means over the area; the normal is a unit vector */
    int direction;
    uint32_t patch;         /* 0 without patches */
    uint32_t next;          /* next element of the cube, or BLOCK_MAP_NONE */
    uint32_t next_of_patch; /* next element of the cube with the same patch */
} element;

typedef struct elements {
    double edge; /* edge of a cube */
    vec3 origin;
    block_map map;   /* cubes that the surface crosses */
    uint32_t *first; /* first element of each cube */
    bool by_patch;   /* There are patches: `pairs` has the first element of each cube and patch. */
    block_map pairs;
    uint32_t *first_of_pair;
    element *element;
    uint32_t count;
} elements;

typedef struct elements_cube {
    int32_t at[3];
} elements_cube;

/* Makes elements from samples of the cells. `edge`: of a cube. Free *out also after failure. Error:
 * limit_memory. */
bool elements_make(const surface *scan, const cell_samples *sample, double edge, elements *out, error *e);
void elements_free(elements *s);

elements_cube elements_cube_of(const elements *s, vec3 x);

/* The first element of the cube at the offset (i, j, k); continue with `next`. BLOCK_MAP_NONE: there is
 * none. */
static inline uint32_t elements_first(const elements *s, elements_cube from, int i, int j, int k)
{
    uint32_t number = block_map_find(&s->map, from.at[0] + i, from.at[1] + j, from.at[2] + k);
    return number == BLOCK_MAP_NONE ? BLOCK_MAP_NONE : s->first[number];
}

/* The first element of a patch in the cube at the offset; continue with `next_of_patch`. A cube may have
 * thousands of patches. */
static inline uint32_t elements_first_of(const elements *s, elements_cube from, int i, int j, int k,
                                         uint32_t patch)
{
    uint32_t number = block_map_find(&s->map, from.at[0] + i, from.at[1] + j, from.at[2] + k);
    if (number == BLOCK_MAP_NONE || !s->by_patch) return number == BLOCK_MAP_NONE ? number : s->first[number];
    number = block_map_find(&s->pairs, (int32_t)number, (int32_t)patch, 0);
    return number == BLOCK_MAP_NONE ? BLOCK_MAP_NONE : s->first_of_pair[number];
}

/* The element that contains a sample at x with this normal and patch, or BLOCK_MAP_NONE. */
uint32_t elements_find(const elements *s, vec3 x, vec3 normal, uint32_t patch);

#endif
