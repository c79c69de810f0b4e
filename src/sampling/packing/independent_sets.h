// SPDX-License-Identifier: Apache-2.0
/* independent_sets: sets of points no two of which are neighbours. Updating the points of a set at once gives
 * the same result as one after the other. The points of a set are from a few blocks of one colour.
 *
 * Consecutive sets of a block advance across it, so that most data of a set are in the cache from the set
 * before. */
#ifndef HEXAD_SAMPLING_PACKING_INDEPENDENT_SETS_H
#define HEXAD_SAMPLING_PACKING_INDEPENDENT_SETS_H

#include <stddef.h>
#include <stdint.h>

#include "base/core/threads.h"
#include "sampling/packing/fast_kernel.h"
#include "sampling/packing/neighbours.h"

#define INDEPENDENT_SET_MOST FAST_KERNEL_LANES
/* Marks the last point of a set in `bin_item`; indices are smaller than this. */
#define INDEPENDENT_SET_LAST ((uint32_t)1 << 31)

/* The number of groups of blocks of a colour. The blocks of a group share sets, because the last sets of a
 * group are not full. Groups have about the same number of points, and their number is even, so that two
 * threads have equal work. */
size_t independent_sets_groups(const neighbours *n, int colour);

/* The first block of a group, in the order of updates. For `group` equal to the number of groups: the end of
 * the colour. A group may be empty. */
size_t independent_sets_group_begin(const neighbours *n, int colour, size_t group);

/* Sorts the points of each group in `bin_item` by sets. Afterwards `bin_item` is valid for the functions
 * below only, not by bins. The result does not depend on the number of threads. */
void independent_sets_form(neighbours *n, threads *pool);

static inline uint32_t independent_sets_point(const neighbours *n, uint32_t at)
{
    return n->bin_item[at] & ~INDEPENDENT_SET_LAST;
}

/* The points of the set that begins at `at`, at most INDEPENDENT_SET_MOST. Returns their number. */
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
