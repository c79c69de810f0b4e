/* particles: the state of the system, as arrays. World space. Index i is one particle throughout. */
#ifndef HEXAD_SOLVER_PARTICLES_H
#define HEXAD_SOLVER_PARTICLES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "field/patches.h"

typedef struct particles {
    size_t count, capacity;
    vec3 *position;
    vec3 *normal;  /* unit; of the last projection */
    double *alpha; /* repulsion amplitude (14), lagged to the last build; NULL: 1 each */
    double *size;  /* requested spacing over h, lagged to the last build; NULL: 1 each */
    float *lambda; /* log10 of the damping of (11) */
    float *energy; /* E_i over size^2, full sum, when it was last looked at: comparable with the ideal */
    /* within 2 h of a boundary of an open surface, at the last build of lists; or held on a curve, or one who is lies within its
     * support */
    bool *near_boundary;
    /* Of a surface with patches, else NULL. A point on a curve is a particle for each patch there. */
    const field_patches *patches;
    uint32_t *patch; /* which it belongs to; it leaves it for a place of another, but not by moving */
    uint32_t *hint;  /* where it was on that: see sample_patch_lanes of field_ops */
    uint32_t *place; /* number of the point on a curve that holds it (curve_samples), or one of these two */
} particles;

#define PARTICLES_FREE UINT32_MAX
#define PARTICLES_HELD (UINT32_MAX - 1) /* held where it is, on no curve */

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
    return particles_is_fixed(p, i) && p->place[i] != PARTICLES_HELD;
}

/* The field that particle i is on, of the field of all. */
static inline const field *particles_field(const particles *p, const field *f, size_t i)
{
    return p->patch ? field_of_patch(f, p->patch[i]) : f;
}

/* Its patch; 0 where there are none. */
static inline uint32_t particles_patch(const particles *p, size_t i)
{
    return p->patch ? p->patch[i] : 0;
}

static inline bool particles_is_one_sided(const particles *p, size_t i)
{
    return p->patch && p->patches->patch[p->patch[i]].one_sided;
}

/* The cosine between the normals of two particles of one patch, as far as their sides mean something. */
static inline double particles_facing(const particles *p, size_t i, size_t j)
{
    double cosine = vec3_dot(p->normal[i], p->normal[j]);
    return particles_is_one_sided(p, i) ? fabs(cosine) : cosine;
}

/* `count` of them, and room for no more, with amplitudes and sizes of 1. Error: limit_memory. */
particles *particles_new(size_t count, error *e);

/* The same without arrays of these, which all particles of an even job would share in vain; and one of them, where there is none.
 * Errors: limit_memory. */
particles *particles_new_even(size_t count, error *e);
bool particles_add_amplitudes(particles *p, error *e);
bool particles_add_sizes(particles *p, error *e);

/* Of a surface with patches: every particle is a free one of the first patch from now on. NULL: of one without. `capacity`
 * as that of particles_new. Error: limit_memory. */
bool particles_label(particles *p, const field_patches *patches, size_t capacity, error *e);
void particles_free(particles *p);

/* What packing.h calls flags, of each; for a surface with patches. */
void particles_flags(const particles *p, uint8_t *out);

/* How many are not held. */
size_t particles_free_count(const particles *p);

/* Makes room for `capacity` particles, at least as many as there are; those there stay. Error:
 * limit_memory. */
bool particles_grow(particles *p, size_t capacity, error *e);

/* Particle `to` becomes what `from` is; what the next build of lists or sweep sets anew is left out. */
void particles_copy(particles *p, size_t to, size_t from);

/* No particle's step is damped from now on. */
void particles_undamp(particles *p);

/* Particle k becomes what order[k] is, a permutation; likewise. Damping is taken along with patches only: others begin anew. `pool` may be NULL. Error: limit_memory. */
bool particles_arrange(particles *p, const uint32_t *order, threads *pool, error *e);

/* Sets p->near_boundary of every particle of an open surface (packing_is_near_boundary). The spacing of a particle is `h` times its
 * size. Of other surfaces it stays as it is. */
void particles_mark_boundary(particles *p, const field *f, double h);

#endif
