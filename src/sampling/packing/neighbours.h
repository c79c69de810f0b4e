// SPDX-License-Identifier: Apache-2.0
/* neighbours: neighbour lists from spatial bins, and an order of updates for which the result does not depend
 * on the number of threads. Each point has a size. Two points are neighbours if their distance is below the
 * cutoff times the mean of their sizes. Bins have levels: the points of a level have sizes within a factor of
 * 2, and lie in cubes whose edge is the cutoff for the largest size of the level. The cubes of levels nest.
 * They are gathered in blocks, which are hashed, so that memory is used only where points are. Blocks of one
 * level whose coordinates have the same parity have one colour. Two points in different blocks of one colour
 * are farther apart than their cutoff, so that neither is in the list of the other. The blocks of a colour
 * are therefore updated in parallel, and the colours one after the other, with the result of one thread
 * (Gauss-Seidel). Lists are valid until a point has moved farther than its size times (cutoff - support) /
 * 2. */
#ifndef HEXAD_SAMPLING_PACKING_NEIGHBOURS_H
#define HEXAD_SAMPLING_PACKING_NEIGHBOURS_H

#include <assert.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/vec3.h"

/* An assertion in inner loops, which would cost one or two per cent of a job: enabled in the sanitized
 * build only. */
#ifdef __SANITIZE_ADDRESS__
#define NEIGHBOURS_CHECK(condition) assert(condition)
#else
#define NEIGHBOURS_CHECK(condition) ((void)0)
#endif

#define NEIGHBOURS_LEVELS 16 /* sizes up to 1 : 2^15 */
#define NEIGHBOURS_COLOURS (8 * NEIGHBOURS_LEVELS)

/* The position of a point in units of 2^-30 of the bounding box (with narrowed gaps), and its size. Differences are exact for any
 * origin. The struct takes a quarter of a cache line. */
typedef struct neighbours_place {
    int32_t x, y, z;
    float size;
} neighbours_place;

/* A range without points, across an axis: coordinates from `from` on are reduced by `cut`, the width that it and those
 * before it lose. */
typedef struct neighbours_gap {
    double from, cut;
} neighbours_gap;

typedef struct neighbours {
    size_t capacity; /* maximum number of points */
    size_t count;
    double cutoff; /* cutoff for two points of size 1 */
    double edge;   /* edge of a bin of level 0 */
    int levels;    /* number of levels in use */

    size_t bin_capacity, bin_count; /* bins are numbered block by block, in the order of updates */
    uint32_t *bin_begin;            /* bins + 1: the bin's points in `bin_item` */
    uint16_t *bin_cell;             /* per bin: index of its cell in its block */
    uint32_t *bin_item;             /* points by bin, ascending; or as independent_sets_form leaves them */
    /* per axis, if points lie far apart: ranges without points, ascending. They are narrowed, so that bins and places
     * depend on the points and not on the size of the scene */
    neighbours_gap *gap[3];
    size_t gaps[3];
    bool has_gaps;
    vec3 origin;
    double unit, per_unit;   /* world units per unit of place, and its inverse */
    neighbours_place *place; /* per point: position and size at the build, or after neighbours_move */

    size_t block_capacity, blocks;
    uint32_t *table;     /* open addressing: block + 1, or 0 */
    size_t table_size;   /* a power of two */
    uint64_t *block_key; /* per block: its level and coordinates */
    /* cells of each block, in rows along x: CELL_BIN, CELL_SPLIT */
    uint16_t *cell;
    uint32_t *block_first; /* per block: its first bin */
    uint32_t *block_size;  /* per block: its number of bins */
    uint32_t *block_begin; /* blocks + 1, in the order of updates: their bins */
    /* number of colours in use, 8 for each level */
    int colours;
    uint32_t colour_begin[NEIGHBOURS_COLOURS + 1]; /* range of blocks of each colour */

    const uint32_t
        *label; /* per point, owned by the caller, set before a build: lists contain only points of the same
                 * label; NULL: all points */
    size_t list_limit;    /* maximum bytes of the lists */
    size_t list_capacity; /* capacity in entries */
    uint32_t *list;       /* the list of point i begins at list_begin[i]; its order has no meaning */
    uint32_t *list_begin; /* per point */
    uint32_t *list_count;
    size_t longest; /* length of the longest list */
} neighbours;

/* Lists for at most `capacity` points, of at most `list_limit` bytes. NULL: limit_memory. */
neighbours *neighbours_new(size_t capacity, size_t list_limit, error *e);
void neighbours_free(neighbours *n);

/* Builds bins and lists for `count` points of the given sizes, > 0 (NULL: 1). Lists are full: j is in the
 * list of i if and only if i is in the list of j; a point is not in its own list. May allocate memory if
 * points are dense. Errors: limit_memory, cancelled. */
bool neighbours_build(neighbours *n, size_t count, const vec3 *x, const double *size, double cutoff,
                      threads *pool, error *e);

/* The list_count[i] neighbours of point i. Reading on up to the length of the longest list is permitted; the
 * further entries are points, too. */
static inline const uint32_t *neighbours_list(const neighbours *n, size_t i)
{
    NEIGHBOURS_CHECK(i < n->count && n->list_begin[i] <= n->list_capacity);
    return n->list + n->list_begin[i];
}

/* The points of the blocks `from` .. `to` - 1, in the order of updates: bin_item[*begin] ..
 * bin_item[*end - 1]. */
static inline void neighbours_block_points(const neighbours *n, size_t from, size_t to, uint32_t *begin,
                                           uint32_t *end)
{
    assert(from <= to && to <= n->blocks);
    *begin = n->bin_begin[n->block_begin[from]];
    *end = n->bin_begin[n->block_begin[to]];
}

/* x with narrowed gaps. */
vec3 neighbours_narrowed(const neighbours *n, vec3 x);

/* The place of a point of the given size at x. */
static inline neighbours_place neighbours_place_of(const neighbours *n, vec3 x, float size)
{
    if (n->has_gaps) x = neighbours_narrowed(n, x);
    vec3 d = vec3_scale(vec3_sub(x, n->origin), n->per_unit);
    return (neighbours_place){(int32_t)d.x, (int32_t)d.y, (int32_t)d.z, size};
}

/* Sets place[i] after point i has moved to x; bins and lists are unchanged. */
static inline void neighbours_move(neighbours *n, size_t i, vec3 x)
{
    NEIGHBOURS_CHECK(i < n->count);
    n->place[i] = neighbours_place_of(n, x, n->place[i].size);
}

#endif
