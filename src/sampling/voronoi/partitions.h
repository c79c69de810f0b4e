// SPDX-License-Identifier: Apache-2.0
/* partitions: divides a point set into slabs across the longest side of its bounding box, so that neighbour
 * lists are in memory for one partition at a time. World space.
 *
 * There are 1 to 16 partitions. A set of fewer than 200 000 points has one. Sets of up to 3.2 million points
 * have partitions of about 100 000 to 200 000 points; larger sets have 16, which are larger. The points of
 * the halo (see partition) come in addition.
 */
#ifndef HEXAD_SAMPLING_VORONOI_PARTITIONS_H
#define HEXAD_SAMPLING_VORONOI_PARTITIONS_H

#include <assert.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/vec3.h"
#include "sampling/packing/neighbours.h"

/* The points. Arrays are owned by the caller and outlive the partitions. */
typedef struct partitions_input {
    size_t count;
    const vec3 *position, *normal;
    const double *spacing; /* per point, world units, > 0 */
    /* per point; its list contains only points of the same label; NULL: all have one label */
    const uint32_t *label;
    const uint8_t *flags; /* per point, of sampling/packing/point_flags.h; NULL: none */
    double cutoff; /* reach of the lists: maximum distance of a pair as a multiple of its mean spacing */
} partitions_input;

typedef struct partitions_span {
    double low, high;
} partitions_span;

typedef struct partitions {
    int axis; /* normal to the cuts */
    size_t count;
    double *end;           /* per partition: its upper end along the axis */
    partitions_span *span; /* per 256 consecutive points: their range along the axis */
    double halo; /* width of the neighbourhood that a partition includes on both sides, world units */
    size_t most; /* maximum number of points of a partition, halo included */
} partitions;

/* Computes the cuts. Free *out also after failure. Error: limit_memory. */
bool partitions_cut(const partitions_input *in, threads *pool, partitions *out, error *e);
void partitions_free(partitions *s);

/* The points of one partition and of its halo, in the order of the set. The halo is wide enough that the
 * lists are complete for the partition's own points, for their neighbours and for the neighbours of these. */
typedef struct partition {
    int axis;
    double low, high; /* range of the own points along the axis: low <= x < high */
    size_t count;     /* halo included */
    vec3 *position, *normal;
    double *spacing;
    uint32_t *index; /* per point: its index in the set, ascending */
    uint32_t *label; /* per point; NULL if the input has none */
    uint8_t *flags;  /* per point; NULL if the input has none */
    neighbours *near;
} partition;

/* Loads partition k, which may be empty, to *out. Before the call *out must be zeroed or hold another
 * partition of the same set, whose arrays are reused. Free *out also after failure. Errors: limit_memory,
 * cancelled. */
bool partition_fill(const partitions_input *in, const partitions *all, size_t k, threads *pool,
                    partition *out, error *e);
void partition_free(partition *s);

/* Whether point i is one of the partition's own, not of the halo. */
static inline bool partition_owns(const partition *s, size_t i)
{
    assert(i < s->count);
    double at = vec3_get(s->position[i], s->axis);
    return at >= s->low && at < s->high;
}

#endif
