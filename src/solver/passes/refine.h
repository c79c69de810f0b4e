/* refine: from a coarse packing to one of about four times as many particles, on the middles of the Delaunay
 * edges, which keeps the packing's order. */
#ifndef HEXAD_SOLVER_REFINE_H
#define HEXAD_SOLVER_REFINE_H

#include "base/error.h"
#include "base/threads.h"
#include "field/field.h"
#include "solver/curves/quota.h"
#include "solver/particles/particles.h"
#include "sizing/curve_distance.h"
#include "sizing/sizing_field.h"
#include "surface/surface.h"

/* How many particles to solve for so that refining gives at least `count`. A closed surface of Euler
 * characteristic x has 3 (n - x) edges, so n become 4 n - 3 x; spheres, x = 2, have the fewest. */
size_t refine_coarser(size_t count);

/* The particles with their Delaunay edges. */
typedef struct refine_mesh refine_mesh;

/* Of the particles where they are, of `spacing` at size 1. Errors: limit_memory, cancelled (the pool was told to stop). */
refine_mesh *refine_mesh_new(const particles *p, double spacing, threads *pool, error *e);
void refine_mesh_free(refine_mesh *m);

/* How many edges it has, which is how many particles refining adds. */
size_t refine_mesh_edges(const refine_mesh *m);

/* What refining has to keep to on a surface with patches. */
typedef struct refine_patches {
    const quota *next;            /* the finer level's */
    const curve_distance *curves; /* new particles keep away from them */
} refine_patches;

/* Adds particles until there are exactly `count` (p has room for them): those on the middles of Delaunay
 * edges, with the shortest of these left out when they are too many, and two on the longest when they are too
 * few; what is missing even so is drawn from the surface by `sizing` (NULL: evenly). `m` is of the particles at hand,
 * which have not moved since, and of no use afterwards; `spacing` is as there. The same for any number of threads. Errors: limit_memory, no_surface,
 * cancelled.
 *
 * With `patches` (else NULL) each patch gets as many as it is allotted, none between two that are held on one curve, and the
 * finer level's rows take the place of those there are; `count` is that of the free particles. */
bool refine_particles(const field *f, const surface *scan, const sizing_field *sizing,
                      const refine_patches *patches, refine_mesh *m, particles *p, size_t count,
                      double spacing, uint64_t seed, threads *pool, error *e);

#endif
