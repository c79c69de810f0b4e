/* kernel: the forces on one particle, in single precision: where the solver's time goes once a packing is
 * nearly at rest.
 *
 * The potential (6), its slope (7) and the first term of its Hessian (10) in the particle's tangent frame,
 * like pair_forces_at, for neighbours that all face its way and under the cotangent alone. Positions are
 * integers, so that their differences are exact; what single precision leaves is an error of some 1e-6 of
 * the spacing in a step. Results are the same to the last bit with any instruction set. Pure. */
#ifndef HEXAD_SAMPLER_KERNEL_H
#define HEXAD_SAMPLER_KERNEL_H

#include <stddef.h>
#include <stdint.h>

#include "base/isa.h"
#include "sampler/neighbours.h"

/* Distances are in units of places. */
typedef struct kernel_forces {
    float energy;        /* E_i over size^2, full sum */
    float d1, d2;        /* its slopes along the two axes */
    float h11, h12, h22; /* first term of (10) in the frame */
    float nearest2;      /* squared distance of the nearest neighbour within the support; inf: none */
} kernel_forces;

/* The neighbours in `list` of a particle at `own`. A pair's support is `support` times the mean of its sizes.
 */
typedef void (*kernel)(const neighbours_place *place, const uint32_t *list, size_t count,
                       neighbours_place own, const float axis1[3], const float axis2[3], float support,
                       kernel_forces *out);

kernel kernel_for(isa which);

#endif
