/* elements: the surface in coarse pieces: the mean place, normal and area of what of it lies in a cube, one piece for each
 * of six directions of the normal, so that sheets that face each other are told apart, and for each patch. World units. Immutable once made,
 * safe in any thread. */
#ifndef HEXAD_SIZING_ELEMENTS_H
#define HEXAD_SIZING_ELEMENTS_H

#include "base/error.h"
#include "geometry/block_map.h"
#include "sizing/cell_samples.h"
#include "surface/surface.h"

/* Edge of a cube, over that of the surface's cells, below which cubes would be passed over. */
#define ELEMENTS_LEAST_EDGE 1.25

typedef struct element {
    double area;
    vec3 position, normal; /* means over the area; the normal is a unit vector */
    int direction;
    uint32_t patch;         /* 0 where there are none */
    uint32_t next;          /* of the same cube, or BLOCK_MAP_NONE */
    uint32_t next_of_patch; /* the next of them of the same patch */
} element;

typedef struct elements {
    double edge; /* of a cube */
    vec3 origin;
    block_map map;   /* of the cubes that the surface passes */
    block_map group; /* of 4^3 cubes, those that hold one of them */
    uint64_t *cubes; /* of each group a bit for each cube of the surface */
    uint32_t *first; /* the first element of each */
    bool
        by_patch; /* there are patches: of each cube's number and patch that meet (`pairs`) the first element, too */
    block_map pairs;
    uint32_t *first_of_pair;
    element *element;
    uint32_t count;
} elements;

typedef struct elements_cube {
    int32_t at[3];
} elements_cube;

/* From the samples of the cells. Free *out after failure, too. Error: limit_memory. */
bool elements_make(const surface *scan, const cell_samples *sample, double edge, elements *out, error *e);
void elements_free(elements *s);

elements_cube elements_cube_of(const elements *s, vec3 x);

/* Which cubes up to `reach` away from one, ELEMENTS_REACH at most, the surface passes: to ask here first is cheaper than to look for
 * each. */
#define ELEMENTS_REACH 5
typedef struct elements_around {
    int32_t low[3];     /* the group of least coordinates */
    uint64_t cubes[64]; /* of groups within reach */
} elements_around;
void elements_look(const elements *s, elements_cube from, int reach, elements_around *out);

static inline bool elements_passes(const elements_around *a, elements_cube from, const int offset[3])
{
    const int x = from.at[0] + offset[0] - 4 * a->low[0], y = from.at[1] + offset[1] - 4 * a->low[1],
              z = from.at[2] + offset[2] - 4 * a->low[2];
    return a->cubes[x / 4 + 4 * (y / 4) + 16 * (z / 4)] >> (x % 4 + 4 * (y % 4) + 16 * (z % 4)) & 1;
}

/* The first element of the cube that lies (i, j, k) cubes away; go on with `next`. BLOCK_MAP_NONE: there is none. */
static inline uint32_t elements_first(const elements *s, elements_cube from, int i, int j, int k)
{
    uint32_t number = block_map_find(&s->map, from.at[0] + i, from.at[1] + j, from.at[2] + k);
    return number == BLOCK_MAP_NONE ? BLOCK_MAP_NONE : s->first[number];
}

/* Of those the first of a patch; go on with `next_of_patch`. A cube may hold thousands of patches. */
static inline uint32_t elements_first_of(const elements *s, elements_cube from, int i, int j, int k,
                                         uint32_t patch)
{
    uint32_t number = block_map_find(&s->map, from.at[0] + i, from.at[1] + j, from.at[2] + k);
    if (number == BLOCK_MAP_NONE || !s->by_patch) return number == BLOCK_MAP_NONE ? number : s->first[number];
    number = block_map_find(&s->pairs, (int32_t)number, (int32_t)patch, 0);
    return number == BLOCK_MAP_NONE ? BLOCK_MAP_NONE : s->first_of_pair[number];
}

/* The element that a sample at x with this normal, of this patch, went into, or BLOCK_MAP_NONE. */
uint32_t elements_find(const elements *s, vec3 x, vec3 normal, uint32_t patch);

#endif
