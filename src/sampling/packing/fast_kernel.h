// SPDX-License-Identifier: Apache-2.0
/* fast_kernel: forces, steps and energies of sixteen particles at once, one per SIMD lane. Most of the time
 * of a solve is spent here.
 *
 * A fast step is one step of the quadratic model of the energy in the tangent plane, followed by one Newton
 * step onto the surface. The energy at its end is not evaluated. Forces are in single precision: the
 * derivative (7) of the cotangent potential (6) and the first term of its Hessian (10) in the tangent frame,
 * as in pair_forces_at. Pairs have amplitudes (13) if particles have them. Guarded steps use the same
 * functions, with facing weights, damping, and energies at the end. Positions are integers, so that their differences are exact; the error of a step is about 1e-6
 * spacings. The result of a lane is the same to the last bit for every instruction set and for any
 * contents of the other lanes. Pure functions, any thread. */
#ifndef HEXAD_SAMPLING_PACKING_FAST_KERNEL_H
#define HEXAD_SAMPLING_PACKING_FAST_KERNEL_H

#include <stdbool.h>
#include <stdint.h>

#include "base/core/isa.h"
#include "sampling/packing/neighbours.h"

#define FAST_KERNEL_LANES VEC3_LANES

/* For all steps. FAST_KERNEL_HESSIAN_FLOOR, over the trace, is added to the diagonal: the 2 x 2 system stays
 * regular if all neighbours are collinear. FAST_KERNEL_BOUND_SHARE: maximum length of the step in the tangent
 * plane over the maximum displacement; the projection adds to it. */
#define FAST_KERNEL_HESSIAN_FLOOR 1e-9
#define FAST_KERNEL_BOUND_SHARE 0.9

/* Particles and their neighbour lists. Each list is read up to the largest `count` of all lanes; all entries
 * read must be points. Entries beyond the lane's own count do not affect its result, also if another
 * thread moves these points. */
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
    float nearest2
        /* squared distance of the nearest neighbour with weight > 0 within the support; infinity: none */
        [FAST_KERNEL_LANES];
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
    double longest;  /* maximum length of a step over size, world units; a longer step fails (!ends_well) */
    double farthest; /* maximum distance from the surface before the Newton step over size, world units */
    const fast_kernel_factors *factors; /* of all points; not read unless one of the following is set */
    bool has_facing;                    /* pairs have facing weights (pair_weigh); otherwise these are 1 */
    bool has_amplitudes;                /* pairs have the mean amplitude of their points; otherwise it is 1 */
} fast_kernel_params;

/* Positions of the particles during a step: after the step in the tangent plane, then on the surface. */
typedef struct fast_kernel_way {
    vec3_lanes to;
    vec3_lanes gradient; /* of the field at `to`, as `value`: input of `land`; afterwards the unit normal */
    double value[FAST_KERNEL_LANES];
    double limit2[FAST_KERNEL_LANES];  /* squared maximum displacement */
    double length[FAST_KERNEL_LANES];  /* displacement after `land` */
    double gain[FAST_KERNEL_LANES];    /* decrease of E_i over size^2 by the quadratic model */
    bool ends_well[FAST_KERNEL_LANES]; /* the step has not failed */
} fast_kernel_way;

typedef struct fast_kernel {
    void (*forces)(const neighbours_place *place, const fast_kernel_particles *particles,
                   const fast_kernel_params *params, fast_kernel_forces *out);
    /* The step in the tangent plane, limited by allowed_step and by the distance of the nearest neighbour. */
    void (*step)(const fast_kernel_particles *particles, const fast_kernel_forces *forces,
                 const fast_kernel_params *params, fast_kernel_way *out);
    /* The Newton step onto the surface, from value and gradient. */
    void (*land)(const fast_kernel_particles *particles, const fast_kernel_params *params,
                 fast_kernel_way *way);
    /* E_i over size^2 of the first `count` particles, as `forces` computes it. All lanes hold points. Half of
     * the lanes take half of the time, except with avx512. */
    void (*energy)(const neighbours_place *place, const fast_kernel_particles *particles,
                   const fast_kernel_params *params, size_t count, float out[FAST_KERNEL_LANES]);
} fast_kernel;

/* The kernel for an instruction set. Static storage. */
const fast_kernel *fast_kernel_for(isa which);

#endif
