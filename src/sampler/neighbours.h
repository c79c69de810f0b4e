/* neighbours: who is within a cutoff of whom, from spatial bins, and an order of updates in which
 * any number of threads gives the same result.
 *
 * Bins are cubes with edge = cutoff (hashed, so that only those with points cost memory). Bins of the
 * same parity in every axis have one colour; two points in different bins of one colour are farther
 * apart than the cutoff, so neither is in the other's list: the bins of a colour may be updated at once,
 * the eight colours one after the other, and the result is that of one thread (Gauss-Seidel).
 * The lists stay valid while no point has moved farther than half of (cutoff - support).
 */
#ifndef HEXAD_SAMPLER_NEIGHBOURS_H
#define HEXAD_SAMPLER_NEIGHBOURS_H

#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/vec3.h"

#define NEIGHBOURS_COLOURS 8

typedef struct neighbours {
    size_t capacity; /* points there is room for */
    size_t count;
    double cutoff;

    size_t bin_count;
    uint32_t *bin_begin; /* bin_count + 1: the bin's points in `bin_item` */
    uint32_t *bin_item;  /* points by bin, ascending within a bin */
    uint64_t *bin_key;
    uint32_t *bin_of;  /* of each point */
    uint32_t *table;   /* open addressing: bin + 1, or 0 */
    size_t table_size; /* a power of two */
    vec3 origin;

    uint32_t colour_begin[NEIGHBOURS_COLOURS + 1];
    uint32_t *colour_bin; /* bins by colour, ascending */

    size_t list_limit;    /* bytes that the lists may take */
    size_t stride;        /* room for this many entries per point */
    uint32_t *list;       /* entry k of point i at [i * stride + k] */
    uint32_t *list_count; /* of each point */
} neighbours;

/* Room for `capacity` points, whose lists may take `list_limit` bytes. Error: limit_memory. */
neighbours *neighbours_new(size_t capacity, size_t list_limit, error *e);
void neighbours_free(neighbours *n);

/* Bins and lists for `count` points (full lists: j in the list of i and i in that of j; a point is not
 * in its own). May grow its memory when points are crowded. Errors: limit_memory. */
bool neighbours_build(neighbours *n, size_t count, const vec3 *x, double cutoff, threads *pool, error *e);

static inline const uint32_t *neighbours_list(const neighbours *n, size_t i)
{
    return n->list + i * n->stride;
}

#endif
