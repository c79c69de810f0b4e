// SPDX-License-Identifier: Apache-2.0
/* refine: inserts particles at the midpoints of the Delaunay edges of a packing. The result has about four
 * times as many particles and keeps the order of the packing. World space. */
#ifndef HEXAD_SAMPLING_SOLVER_PASSES_REFINE_H
#define HEXAD_SAMPLING_SOLVER_PASSES_REFINE_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/field/field.h"
#include "sampling/solver/curves/quota.h"
#include "sampling/solver/particles/particles.h"
#include "sampling/sizing/curve_distance.h"
#include "sampling/sizing/sizing_field.h"
#include "surface/scan/surface.h"

/* Number of particles of the coarse level from which refinement gives at least `count`. A closed surface of
 * Euler characteristic x has 3 (n - x) edges, so that n become 4 n - 3 x. The sphere (x = 2) has the
 * fewest edges. */
size_t refine_coarser(size_t count);

/* The particles with their Delaunay edges. */
typedef struct refine_mesh refine_mesh;

/* Counts the edges of the particles at their positions. `spacing`: of a particle of size 1. Errors:
 * limit_memory, cancelled. */
refine_mesh *refine_mesh_new(const particles *p, double spacing, threads *pool, error *e);
void refine_mesh_free(refine_mesh *m);

/* Number of edges: the number of particles that refinement inserts. */
size_t refine_mesh_edges(const refine_mesh *m);

/* Additional input for a surface with patches. */
typedef struct refine_patches {
    const quota *next;            /* of the finer level */
    const curve_distance *curves; /* new particles keep a minimum distance from these */
} refine_patches;

/* Inserts particles up to `count`; p has the capacity. One particle is inserted per Delaunay edge. If there
 * are too many edges, the shortest get none; if there are too few, the longest get two. Missing particles are
 * drawn at random by `sizing` (NULL: uniform). `m`, `spacing`: the mesh of these particles, which have not
 * moved since, and its spacing. `m` is invalid afterwards. Deterministic for any number of threads. Errors:
 * limit_memory, no_surface, cancelled.
 *
 * With `patches` (NULL without) each patch gets its quota. Edges along a curve get no particle. The curve
 * samples are replaced by those of the finer level. `count` is then the number of free particles. */
bool refine_particles(const field *f, const surface *scan, const sizing_field *sizing,
                      const refine_patches *patches, refine_mesh *m, particles *p, size_t count,
                      double spacing, uint64_t seed, threads *pool, error *e);

#endif
