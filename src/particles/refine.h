/* refine: from a coarse packing to one of about four times as many particles, on the middles of the Delaunay
 * edges, which keeps the packing's order. */
#ifndef HEXAD_PARTICLES_REFINE_H
#define HEXAD_PARTICLES_REFINE_H

#include "base/error.h"
#include "base/threads.h"
#include "field/field.h"
#include "particles/allotment.h"
#include "particles/particles.h"
#include "surface/curve_distance.h"
#include "surface/sizing_field.h"
#include "surface/surface.h"

/* How many particles to solve for so that refining gives at least `count`. A closed surface of Euler
 * characteristic x has 3 (n - x) edges, so n become 4 n - 3 x; spheres, x = 2, have the fewest. */
size_t refine_coarser(size_t count);

/* How many Delaunay edges the particles have, which is how many refining adds. Errors: limit_memory,
 * cancelled (the pool was told to stop). */
bool refine_count_edges(const particles *p, double spacing, threads *pool, size_t *edges, error *e);

/* What refining has to keep to on a surface with patches. */
typedef struct refine_patches {
    const allotment *next;        /* the finer level's */
    const curve_distance *curves; /* new particles keep away from them */
} refine_patches;

/* Adds particles until there are exactly `count` (p has room for them): those on the middles of Delaunay
 * edges, with the shortest of these left out when they are too many, and two on the longest when they are too
 * few; what is missing even so is drawn from the surface by `sizing` (NULL: evenly). `spacing` is that of the
 * particles at hand, of size 1. The same for any number of threads. Errors: limit_memory, no_surface,
 * cancelled.
 *
 * With `patches` (else NULL) each patch gets as many as it is allotted, none between two that are held on one curve, and the
 * finer level's rows take the place of those there are; `count` is that of the free particles. */
bool refine_particles(const field *f, const surface *scan, const sizing_field *sizing,
                      const refine_patches *patches, particles *p, size_t count, double spacing,
                      uint64_t seed, threads *pool, error *e);

#endif
