/* slabs: a point set part by part along the longest side of its box, so that the lists of who is near whom
 * are those of a part at a time. About a hundred thousand points are in one, but for the largest sets. */
#ifndef HEXAD_PACKING_SLABS_H
#define HEXAD_PACKING_SLABS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/vec3.h"
#include "packing/neighbours.h"

/* The caller's arrays. */
typedef struct slabs_input {
    size_t count;
    const vec3 *position, *normal;
    const double *spacing; /* of each, > 0 */
    double cutoff;         /* lists hold who is within this times the mean of two spacings */
} slabs_input;

typedef struct slabs {
    int axis; /* that they are cut across */
    size_t count;
    double *end; /* of each along the axis */
    double halo; /* around each, of points that are known beside its own */
} slabs;

/* Release also after failure. Error: limit_memory. */
bool slabs_cut(const slabs_input *in, slabs *out, error *e);
void slabs_free(slabs *s);

/* A slab's own points and those around, in their order: the lists of those listed by those listed by its own
 * are whole. */
typedef struct slab {
    int axis;
    double low, high; /* of its own */
    size_t count;
    vec3 *position, *normal;
    double *spacing;
    uint32_t *index; /* of each, among all */
    neighbours *near;
} slab;

/* Slab k; it may have no points of its own. Release also after failure. Errors: limit_memory. */
bool slab_fill(const slabs_input *in, const slabs *all, size_t k, threads *pool, slab *out, error *e);
void slab_free(slab *s);

static inline bool slab_owns(const slab *s, size_t i)
{
    double at = vec3_get(s->position[i], s->axis);
    return at >= s->low && at < s->high;
}

#endif
