/* particles: the state of the system, as arrays. World space. Index i is one particle throughout. */
#ifndef HEXAD_SAMPLER_PARTICLES_H
#define HEXAD_SAMPLER_PARTICLES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "field/field.h"

typedef struct particles {
    size_t count;
    vec3 *position;
    vec3 *normal;   /* unit; of the last projection */
    double *alpha;  /* repulsion amplitude (14), lagged to the last build; 1 without grading */
    double *size;   /* requested spacing over h, lagged to the last build; 1 when even */
    float *lambda;  /* log10 of the damping of (11) */
    double *energy; /* E_i over size^2, full sum, when it was last looked at: comparable with the ideal */
    bool *near_boundary; /* within 2 h of a boundary of an open surface, at the last build of lists */
} particles;

/* Error: limit_memory. */
particles *particles_new(size_t count, error *e);
void particles_free(particles *p);

/* Makes room for `capacity` particles, at least as many as there are; those there stay. Error:
 * limit_memory. */
bool particles_grow(particles *p, size_t capacity, error *e);

/* Particle `to` becomes what `from` is; what the next build of lists or sweep sets anew is left out. */
void particles_copy(particles *p, size_t to, size_t from);

/* Particle k becomes what order[k] is, a permutation; likewise. Error: limit_memory, half of it done. */
bool particles_arrange(particles *p, const uint32_t *order, error *e);

/* Sets p->boundary of every particle: whether it is near the boundary of an open surface (packing_is_near_boundary).
 * The spacing of a particle is `h` times its size. On a closed surface p->boundary stays as it is. */
void particles_mark_boundary(particles *p, const field *f, double h);

#endif
