/* batches: points of a few blocks of one colour that are nobody's neighbours among themselves, so that they
 * may be updated side by side with the result of one after the other.
 *
 * Batches follow one another over a block like a front, so that what one of them reads the one before has
 * just brought into the cache. */
#ifndef HEXAD_PACKING_BATCHES_H
#define HEXAD_PACKING_BATCHES_H

#include <stddef.h>
#include <stdint.h>

#include "base/threads.h"
#include "packing/kernel.h"
#include "packing/neighbours.h"

#define BATCH_MOST KERNEL_LANES
#define BATCH_BLOCKS 4 /* share their batches, from the first of their colour on: fewer end half empty */
/* Marks the last of a batch in `bin_item`; there are never as many points. */
#define BATCH_LAST ((uint32_t)1 << 31)

/* Puts the points of each such group of blocks, in `bin_item`, in the order of their batches. From then on
 * they are read by the functions below, and bins tell no more who is in them. The same whatever the threads
 * are. */
void batches_form(neighbours *n, threads *pool);

static inline uint32_t batches_point(const neighbours *n, uint32_t at)
{
    return n->bin_item[at] & ~BATCH_LAST;
}

/* The batch that begins at `at`: its points, up to BATCH_MOST; returns how many. */
static inline uint32_t batches_next(const neighbours *n, uint32_t at, uint32_t *points)
{
    uint32_t count = 0;
    do points[count++] = batches_point(n, at);
    while (!(n->bin_item[at++] & BATCH_LAST));
    return count;
}

#endif
