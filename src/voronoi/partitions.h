/* partitions: a point set cut into slabs across the longest side of its box, so that neighbour lists are needed for
 * one partition at a time. A partition holds about a hundred thousand points; in the largest sets it holds more. */
#ifndef HEXAD_VORONOI_PARTITIONS_H
#define HEXAD_VORONOI_PARTITIONS_H

#include <assert.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/vec3.h"
#include "packing/neighbours.h"

/* The caller's arrays. */
typedef struct partitions_input {
    size_t count;
    const vec3 *position, *normal;
    const double *spacing; /* of each, > 0 */
    const uint32_t *label; /* of each; lists hold points of one label; NULL: all */
    const uint8_t *flags;  /* of packing.h, of each; NULL: none */
    double cutoff;         /* lists hold who is within this times the mean of two spacings */
} partitions_input;

typedef struct partitions_span {
    double low, high;
} partitions_span;

typedef struct partitions {
    int axis; /* that they are cut across */
    size_t count;
    double *end;           /* where each ends along the axis */
    partitions_span *span; /* along the axis, of each 256 points that follow each other */
    double halo;           /* width on either side, of the points that a partition knows beside its own */
    size_t most;           /* no partition knows more points, its own and others */
} partitions;

/* Release also after failure. Error: limit_memory. */
bool partitions_cut(const partitions_input *in, threads *pool, partitions *out, error *e);
void partitions_free(partitions *s);

/* A partition's own points and those around it, in the order of the set. The halo is so wide that the lists are
 * complete for its own points, for their neighbours and for the neighbours of these. */
typedef struct partition {
    int axis;
    double low, high; /* of its own */
    size_t count;
    vec3 *position, *normal;
    double *spacing;
    uint32_t *index; /* of each, among all */
    uint32_t *label; /* as in the input; NULL likewise */
    uint8_t *flags;
    neighbours *near;
} partition;

/* Partition k; it may have no points of its own. *out is zeros, or holds another one of the same partitions, whose arrays become
 * those of this one. Release also after failure. Errors: limit_memory, cancelled. */
bool partition_fill(const partitions_input *in, const partitions *all, size_t k, threads *pool,
                    partition *out, error *e);
void partition_free(partition *s);

static inline bool partition_owns(const partition *s, size_t i)
{
    assert(i < s->count);
    double at = vec3_get(s->position[i], s->axis);
    return at >= s->low && at < s->high;
}

#endif
