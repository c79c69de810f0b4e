/* carry: the points of one frame taken onto the surface of the next, so that they stay where they were on it.
 *
 * All move with the surface as a whole (sequence/motion) and then each by itself along the gradient onto the
 * surface. A point dies when it does not reach the surface, comes to a sheet that faces another way, or comes
 * to lie closer to another than neighbours can be; where no point is near, one is born on the emptiest place.
 * What is still missing or too much for the count is born on the emptiest places, or taken from the most
 * crowded, no two neighbours at a time as long as there are others; many of them in portions, far from each
 * other, with a few sweeps between. When most points die the surface is
 * another one, which is to be sampled anew. Deterministic for any number of threads. World space and world
 * units. */
#ifndef HEXAD_SEQUENCE_CARRY_H
#define HEXAD_SEQUENCE_CARRY_H

#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/isa.h"
#include "base/threads.h"
#include "field/field.h"
#include "sequence/motion.h"
#include "surface/grading.h"
#include "surface/surface.h"

/* The parent of a point that was born. */
#define CARRY_NONE UINT32_MAX

typedef struct carry_params {
    size_t previous_count;  /* >= 1 */
    const vec3 *position;   /* of the points of the frame before */
    const vec3 *normal;     /* unit */
    size_t count;           /* points there are to be */
    const grading *grading; /* NULL: even */
    bool eased;             /* sweeps, of the kernel's energy, between portions of births and deaths */
    isa isa;                /* of these sweeps */
    uint64_t seed;
} carry_params;

typedef struct carried {
    size_t count; /* as was asked for; 0, and no arrays: the surface is another one, and all have died */
    size_t died, born;
    motion motion;
    vec3 *position; /* on the surface, in the order of Morton's curve */
    vec3 *normal;
    vec3 *landed;     /* where it was carried to, before births and deaths moved it; of one born, no matter */
    vec3 *origin;     /* where it was in the frame before; of one that was born, where it would have been */
    uint32_t *parent; /* its index in the frame before, or CARRY_NONE */
} carried;

/* Errors: limit_memory, no_surface (points cannot be placed), cancelled (the pool was told to stop). The
 * caller frees, also after failure. */
bool carry_points(const field *f, const surface *scan, const carry_params *params, threads *pool,
                  carried *out, error *e);
void carried_free(carried *c);

#endif
