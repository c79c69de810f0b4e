// SPDX-License-Identifier: Apache-2.0
/* fast_kernel: forces, steps and energies of sixteen particles at once, one per SIMD lane. Most of the time
 * of a solve is spent here.
 *
 * A step has three parts:
 * - `forces` computes the energy of each particle, its gradient (7) and the first term of its Hessian (10),
 *   for the cotangent potential (6). Both are those in the tangent frame, as in pair_forces_at.
 * - `tangent_step` takes one Newton step of the energy in the tangent plane.
 * - The caller samples the field at its end. `project` then takes one Newton step of the field onto the
 *   surface.
 *
 * A fast step (relax_fast.c) ends here. A guarded step (relax_guarded.c) has damping and facing weights, and
 * is accepted by the energy at its end, which `energy` computes. Pairs have amplitudes (13) if particles have
 * them.
 *
 * Forces are in single precision. Positions are integers, so that their differences are exact. The error of a
 * step is about 1e-6 spacings. The result of a lane is the same to the last bit for every instruction set and
 * for any contents of the other lanes. Pure functions, any thread. */
#ifndef HEXAD_SAMPLING_PACKING_FAST_KERNEL_H
#define HEXAD_SAMPLING_PACKING_FAST_KERNEL_H

#include <stdbool.h>
#include <stdint.h>

#include "base/core/isa.h"
#include "sampling/packing/neighbours.h"

#define FAST_KERNEL_LANES VEC3_LANES

/* This times the trace is added to the diagonal of the Hessian, which is singular if all neighbours are
 * collinear. */
#define FAST_KERNEL_HESSIAN_FLOOR 1e-9
/* Maximum length of the step in the tangent plane over the maximum displacement. The rest is left for the
 * projection. */
#define FAST_KERNEL_BOUND_SHARE 0.9

/* Particles and their neighbour lists. Each list is read up to the largest `count` of all lanes, and all
 * entries that are read must be points. Entries beyond the lane's own count do not affect its result, not
 * even if another thread moves these points. */
typedef struct fast_kernel_particles {
    const uint32_t *list[FAST_KERNEL_LANES];
    uint32_t count[FAST_KERNEL_LANES];
    /* position and size, as in neighbours_place */
    int32_t x[FAST_KERNEL_LANES], y[FAST_KERNEL_LANES], z[FAST_KERNEL_LANES];
    float size[FAST_KERNEL_LANES];
    /* longest displacement that keeps the lists valid, world units */
    float allowed_step[FAST_KERNEL_LANES];
    float damping[FAST_KERNEL_LANES];   /* lambda of (11); 0: none */
    float amplitude[FAST_KERNEL_LANES]; /* alpha of (13); read with has_amplitudes only */
    vec3_lanes position, normal;
} fast_kernel_particles;

/* Distances are in units of neighbours_place. */
typedef struct fast_kernel_forces {
    float energy[FAST_KERNEL_LANES];                                /* E_i over size^2, full sum */
    float axis1[3][FAST_KERNEL_LANES], axis2[3][FAST_KERNEL_LANES]; /* tangent frames */
    /* derivatives of the energy along the axes */
    float d1[FAST_KERNEL_LANES], d2[FAST_KERNEL_LANES];
    float h11[FAST_KERNEL_LANES], h12[FAST_KERNEL_LANES],
        h22[FAST_KERNEL_LANES]; /* first term of (10) in the frame */
    /* squared distance of the nearest neighbour with weight > 0 within the support; infinity: none */
    float nearest2[FAST_KERNEL_LANES];
    /* Derivative of the energy with respect to the particle's normal, through the facing weights; 0 if all
     * weights are 0 or 1. The caller multiplies it by the rotation of the normal along the axes and adds
     * the product to d1 and d2. */
    float turning[3][FAST_KERNEL_LANES];
    float pairs[FAST_KERNEL_LANES]; /* number of neighbours within the support, facing weights only */
} fast_kernel_forces;

/* Factors of a point in the weights of its pairs: its unit normal and its amplitude. The struct has the size
 * of neighbours_place. */
typedef struct fast_kernel_factors {
    float x, y, z, amplitude;
} fast_kernel_factors;

typedef struct fast_kernel_params {
    double unit;     /* of neighbours_place, world units */
    double support;  /* of a pair of particles of size 1, world units */
    double omega;    /* over-relaxation factor */
    double longest;  /* maximum length of a step over size, world units; a longer step fails (!is_valid) */
    double farthest; /* maximum distance from the surface before the Newton step over size, world units */
    const fast_kernel_factors *factors; /* of all points; not read unless one of the following is set */
    bool has_facing;                    /* pairs have facing weights (pair_weigh); otherwise these are 1 */
    bool has_amplitudes;                /* pairs have the mean amplitude of their points; otherwise it is 1 */
} fast_kernel_params;

typedef struct fast_kernel_step {
    vec3_lanes end; /* position after tangent_step, then after `project` */
    /* of the field at `end`, set by the caller between the two functions; `project` replaces the gradient by
     * the unit normal */
    vec3_lanes gradient;
    double value[FAST_KERNEL_LANES];
    double limit2[FAST_KERNEL_LANES]; /* squared maximum displacement */
    double length[FAST_KERNEL_LANES]; /* displacement after `project` */
    double gain[FAST_KERNEL_LANES];   /* decrease of E_i over size^2 by the quadratic model */
    /* false: the step is longer than its limits, or its end is too far from the surface for one Newton
     * step */
    bool is_valid[FAST_KERNEL_LANES];
} fast_kernel_step;

typedef struct fast_kernel {
    void (*forces)(const neighbours_place *place, const fast_kernel_particles *particles,
                   const fast_kernel_params *params, fast_kernel_forces *out);
    /* Sets end, limit2, gain and is_valid. The maximum displacement is allowed_step or the distance of the
     * nearest neighbour, whichever is smaller. */
    void (*tangent_step)(const fast_kernel_particles *particles, const fast_kernel_forces *forces,
                         const fast_kernel_params *params, fast_kernel_step *out);
    /* Moves `end` by one Newton step onto the surface, from value and gradient there. Clears is_valid if the
     * step fails. */
    void (*project)(const fast_kernel_particles *particles, const fast_kernel_params *params,
                    fast_kernel_step *step);
    /* E_i over size^2 of the first `count` particles, as `forces` computes it. The other lanes must hold
     * points, too. Only as many lanes are computed as `count` requires: a multiple of 4 (portable), 8 (avx2)
     * or 16 (avx512). */
    void (*energy)(const neighbours_place *place, const fast_kernel_particles *particles,
                   const fast_kernel_params *params, size_t count, float out[FAST_KERNEL_LANES]);
} fast_kernel;

/* The kernel for an instruction set. Static storage. */
const fast_kernel *fast_kernel_for(isa which);

#endif
