/* fast_kernel: steps, sixteen particles at a time. Most of the solver's time is spent here once a packing is nearly at rest.
 *
 * A fast step is one step of the quadratic model of the energy in the tangent plane, and one Newton step back onto
 * the surface; the energy at its end is not looked at. The forces are in single precision: the slope (7) of the
 * potential (6) and the first term of its Hessian (10) in the particle's tangent frame, as in pair_forces_at, but for
 * the cotangent only. Guarded steps, which look at the energy, are made of the same parts: pairs weighed by how they face
 * each other, steps that are damped, and energies alone. Each particle has a lane, so that no
 * particle waits for its own sums and no sum has to be folded. Places are integers, so that their differences are
 * exact; single precision leaves an error of about 1e-6 of the spacing in a step. The results of a lane are the same
 * to the last bit with every instruction set and whatever the other lanes hold. Pure functions. */
#ifndef HEXAD_PACKING_FAST_KERNEL_H
#define HEXAD_PACKING_FAST_KERNEL_H

#include <stdbool.h>
#include <stdint.h>

#include "base/isa.h"
#include "packing/neighbours.h"

#define FAST_KERNEL_LANES VEC3_LANES

/* Of every step, fast or general. The floor keeps the 2x2 system solvable when all neighbours lie on one
 * line; the share is what the step in the tangent plane may take of the longest displacement: the projection
 * adds its own. */
#define FAST_KERNEL_HESSIAN_FLOOR 1e-9
#define FAST_KERNEL_BOUND_SHARE 0.9

/* Particles and their neighbours. As many entries of each list as the longest `count` says are read, and must
 * be points; those beyond its own do not count, so that it does not matter if another thread moves them. */
typedef struct fast_kernel_particles {
    const uint32_t *list[FAST_KERNEL_LANES];
    uint32_t count[FAST_KERNEL_LANES];
    int32_t x[FAST_KERNEL_LANES], y[FAST_KERNEL_LANES], z[FAST_KERNEL_LANES]; /* as in neighbours_place */
    float size[FAST_KERNEL_LANES];
    float allowed_step[FAST_KERNEL_LANES]; /* longest displacement that keeps the lists valid, world units */
    float damping[FAST_KERNEL_LANES];      /* lambda of (11); 0: none */
    vec3_lanes position, normal;
} fast_kernel_particles;

/* Distances are in units of places. */
typedef struct fast_kernel_forces {
    float energy[FAST_KERNEL_LANES];                                /* E_i over size^2, full sum */
    float axis1[3][FAST_KERNEL_LANES], axis2[3][FAST_KERNEL_LANES]; /* the frames */
    float d1[FAST_KERNEL_LANES], d2[FAST_KERNEL_LANES]; /* the energy's slopes along the two axes */
    float h11[FAST_KERNEL_LANES], h12[FAST_KERNEL_LANES],
        h22[FAST_KERNEL_LANES]; /* first term of (10) in the frame */
    float nearest2
        [FAST_KERNEL_LANES]; /* squared distance of the nearest that counts, within the support; inf: none */
    /* What the energy grows by with the particle's own normal, through the weights; all 0 where all count in full or not at all.
     * The caller knows how the normal turns along the axes, and adds to d1 and d2. */
    float turning[3][FAST_KERNEL_LANES];
    float pairs[FAST_KERNEL_LANES]; /* how many others are within the support, by their weights */
} fast_kernel_forces;

/* A point's normal; as long as a place, for the vector unit. */
typedef struct fast_kernel_normal {
    float x, y, z, nothing;
} fast_kernel_normal;

typedef struct fast_kernel_params {
    double unit;     /* of places, world */
    double support;  /* of a pair of particles of size 1, world */
    double omega;    /* over-relaxation */
    double longest;  /* longest step, over size; with a longer one a particle does not end well */
    double farthest; /* from the surface, over size, whence one Newton step is enough */
    /* of all points, by which pairs are weighed (pair_weigh); NULL: all count in full */
    const fast_kernel_normal *normal;
} fast_kernel_params;

/* Where the particles are on their way: after the step in the tangent plane, then on the surface. */
typedef struct fast_kernel_way {
    vec3_lanes to;
    vec3_lanes gradient; /* of the field at `to`, and its value: for `land` to read; the normal after it */
    double value[FAST_KERNEL_LANES];
    double limit2[FAST_KERNEL_LANES]; /* squared longest displacement */
    double length[FAST_KERNEL_LANES]; /* of the displacement, after `land` */
    double gain
        [FAST_KERNEL_LANES]; /* decrease of E_i over size^2 that the quadratic model expects of a whole step */
    bool ends_well[FAST_KERNEL_LANES];
} fast_kernel_way;

typedef struct fast_kernel {
    void (*forces)(const neighbours_place *place, const fast_kernel_particles *particles,
                   const fast_kernel_params *params, fast_kernel_forces *out);
    /* The step in the tangent plane, shorter than the allowed step and the way to the nearest neighbour. */
    void (*step)(const fast_kernel_particles *particles, const fast_kernel_forces *forces,
                 const fast_kernel_params *params, fast_kernel_way *out);
    /* The Newton step onto the surface. */
    void (*land)(const fast_kernel_particles *particles, const fast_kernel_params *params,
                 fast_kernel_way *way);
    /* E_i over size^2 at the places and normals of the first `count` of `particles`, as `forces` has it; all lanes hold
     * points, and half of them take half of the time, but with avx512. */
    void (*energy)(const neighbours_place *place, const fast_kernel_particles *particles,
                   const fast_kernel_params *params, size_t count, float out[FAST_KERNEL_LANES]);
} fast_kernel;

const fast_kernel *fast_kernel_for(isa which);

#endif
