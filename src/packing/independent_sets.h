/* independent_sets: sets of points of which no two are neighbours, so that the points of a set may be updated side by
 * side with the same result as one after the other. A set's points come from a few blocks of one colour.
 *
 * The sets of a block follow each other like a front across it: most of what one set reads is in the cache since the
 * set before it. */
#ifndef HEXAD_PACKING_INDEPENDENT_SETS_H
#define HEXAD_PACKING_INDEPENDENT_SETS_H

#include <stddef.h>
#include <stdint.h>

#include "base/threads.h"
#include "packing/fast_kernel.h"
#include "packing/neighbours.h"

#define INDEPENDENT_SET_MOST FAST_KERNEL_LANES
/* Marks the last point of a set in `bin_item`; an index never needs this bit. */
#define INDEPENDENT_SET_LAST ((uint32_t)1 << 31)

/* The blocks of a colour form groups that share their sets, since the last ones of a group end half empty. Groups have about as many
 * points as each other: an even number of them takes two threads equally long. How many there are. */
size_t independent_sets_groups(const neighbours *n, int colour);

/* The first block of a group, counted in the order of updates, or where the colour ends. A group may have none. */
size_t independent_sets_group_begin(const neighbours *n, int colour, size_t group);

/* Sorts the points of each group of blocks in `bin_item` by their sets. From then on only the functions below read
 * `bin_item`, and a bin no longer tells its points. The result does not depend on the number of threads. */
void independent_sets_form(neighbours *n, threads *pool);

static inline uint32_t independent_sets_point(const neighbours *n, uint32_t at)
{
    return n->bin_item[at] & ~INDEPENDENT_SET_LAST;
}

/* The set that begins at `at`: its points, up to INDEPENDENT_SET_MOST. Returns how many. */
static inline uint32_t independent_sets_next(const neighbours *n, uint32_t at, uint32_t *points)
{
    uint32_t count = 0;
    do {
        NEIGHBOURS_CHECK(count < INDEPENDENT_SET_MOST && at < n->count);
        points[count++] = independent_sets_point(n, at);
    } while (!(n->bin_item[at++] & INDEPENDENT_SET_LAST));
    return count;
}

#endif
