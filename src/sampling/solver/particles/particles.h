// SPDX-License-Identifier: Apache-2.0
/* particles: the state of the particle system as a structure of arrays. Index i is the same particle in
 * all arrays. World space. */
#ifndef HEXAD_SAMPLING_SOLVER_PARTICLES_PARTICLES_H
#define HEXAD_SAMPLING_SOLVER_PARTICLES_PARTICLES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/field/patches.h"

typedef struct particles {
    size_t count, capacity;
    vec3 *position;
    vec3 *normal;  /* unit; from the last projection */
    double *alpha; /* repulsion amplitude (14), evaluated at the last list build; NULL: 1 for all */
    double *size;  /* requested spacing over h, evaluated at the last list build; NULL: 1 for all */
    float *lambda; /* log10 of the damping of (11) */
    /* E_i / size^2, summed over all neighbours, at the last evaluation; comparable with the ideal energy */
    float *energy;
    /* At the last list build: within 2 h of a boundary of an open surface, on a curve, or with a particle of
     * a curve in its support. */
    bool *near_boundary;
    /* the curve sample that fixes it (curve_samples), PARTICLES_FREE or PARTICLES_PINNED; NULL: all are
     * free */
    uint32_t *place;
    /* The following are NULL for a surface without patches. A point on a curve is one particle for each
     * incident patch. */
    const field_patches *patches;
    /* the patch it belongs to; relocation may change it, a step of the relaxation never does */
    uint32_t *patch;
    uint32_t *hint; /* location on its patch: sample_patch_lanes of field_ops */
} particles;

#define PARTICLES_FREE UINT32_MAX
#define PARTICLES_PINNED (UINT32_MAX - 1) /* fixed at its position, on no curve */

static inline double particles_amplitude(const particles *p, size_t i)
{
    return p->alpha ? p->alpha[i] : 1;
}

static inline double particles_size(const particles *p, size_t i)
{
    return p->size ? p->size[i] : 1;
}

static inline bool particles_is_fixed(const particles *p, size_t i)
{
    return p->place && p->place[i] != PARTICLES_FREE;
}

static inline bool particles_is_on_curve(const particles *p, size_t i)
{
    return particles_is_fixed(p, i) && p->place[i] != PARTICLES_PINNED;
}

/* The field of the patch of particle i; without patches: f. */
static inline const field *particles_field(const particles *p, const field *f, size_t i)
{
    return p->patch ? field_of_patch(f, p->patch[i]) : f;
}

/* The patch of particle i; 0 without patches. */
static inline uint32_t particles_patch(const particles *p, size_t i)
{
    return p->patch ? p->patch[i] : 0;
}

static inline bool particles_is_one_sided(const particles *p, size_t i)
{
    return p->patch && p->patches->patch[p->patch[i]].one_sided;
}

/* Cosine between the normals of two particles of one patch. On a one-sided patch the sign of normals is
 * meaningless: the absolute value. */
static inline double particles_facing(const particles *p, size_t i, size_t j)
{
    double cosine = vec3_dot(p->normal[i], p->normal[j]);
    return particles_is_one_sided(p, i) ? fabs(cosine) : cosine;
}

/* `count` particles with amplitudes and sizes of 1; the capacity is `count`. NULL: limit_memory. */
particles *particles_new(size_t count, error *e);

/* `count` particles without the arrays alpha and size. NULL: limit_memory. */
particles *particles_new_even(size_t count, error *e);

/* Allocate alpha or size, filled with 1, unless it exists. Error: limit_memory. */
bool particles_add_amplitudes(particles *p, error *e);
bool particles_add_sizes(particles *p, error *e);

/* Allocates place, filled with PARTICLES_FREE, unless it exists. Error: limit_memory. */
bool particles_add_places(particles *p, error *e);

/* Allocates the arrays for patches: every particle becomes a free particle of the first patch. `patches`
 * NULL: does nothing. `capacity`: that of `p`. Error: limit_memory. */
bool particles_set_patches(particles *p, const field_patches *patches, size_t capacity, error *e);
void particles_free(particles *p);

/* Flags of point_flags.h for each particle of a surface with patches. */
void particles_flags(const particles *p, uint8_t *out);

/* Number of particles that are not fixed. */
size_t particles_free_count(const particles *p);

/* Increases the capacity to `capacity`, at least the count. Error: limit_memory, *p unchanged. */
bool particles_grow(particles *p, size_t capacity, error *e);

/* Copies particle `from` to index `to`, except near_boundary, which the next list build sets. */
void particles_copy(particles *p, size_t to, size_t from);

/* Resets the damping of all particles. */
void particles_reset_damping(particles *p);

/* Permutes the particles: index k gets what order[k] had, except near_boundary. Damping and energy are
 * permuted only with patches; otherwise the caller resets them. `pool` may be NULL. Error: limit_memory. */
bool particles_arrange(particles *p, const uint32_t *order, threads *pool, error *e);

/* Sets p->near_boundary of every particle of an open surface (packing_is_near_boundary). The spacing of a
 * particle is `h` times its size. Clears it on a closed surface if particles may be fixed; the next list
 * build marks those near fixed particles. */
void particles_mark_boundary(particles *p, const field *f, double h);

#endif
