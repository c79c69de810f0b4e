/* kernel: particles that glide, sixteen at a time: where the solver's time goes once a packing is nearly at
 * rest.
 *
 * A glide is one step of the quadratic model of the energy, in the tangent plane, and one Newton step back
 * onto the surface. The forces, in single precision, are the slope (7) of the potential (6) and the first
 * term of its Hessian (10) in the particles' tangent frames, like pair_forces_at, for neighbours that all
 * face a particle's way and under the cotangent alone. Particles stand side by side, a lane each, so that
 * none waits for its own sums and no sum has to be folded. Places are integers, so that their differences
 * are exact; what single precision leaves is an error of some 1e-6 of the spacing in a step. A lane's
 * results are the same to the last bit with any instruction set and whatever the other lanes are. Pure. */
#ifndef HEXAD_PACKING_KERNEL_H
#define HEXAD_PACKING_KERNEL_H

#include <stdbool.h>
#include <stdint.h>

#include "base/isa.h"
#include "packing/neighbours.h"

#define KERNEL_LANES 16

/* Of any step, gliding or watched. The floor keeps the 2x2 system solvable when all neighbours lie on one
 * line; the share is what the step in the tangent plane may take of the longest displacement: the projection
 * adds its own. */
#define KERNEL_HESSIAN_FLOOR 1e-9
#define KERNEL_BOUND_SHARE 0.9

/* A vector for each particle. */
typedef struct kernel_vec3 {
    double x[KERNEL_LANES], y[KERNEL_LANES], z[KERNEL_LANES];
} kernel_vec3;

/* Particles and their neighbours. As many entries of each list as the longest `count` says are read, and must
 * be points; those beyond its own do not count, so that it does not matter if another thread moves them. */
typedef struct kernel_particles {
    const uint32_t *list[KERNEL_LANES];
    uint32_t count[KERNEL_LANES];
    int32_t x[KERNEL_LANES], y[KERNEL_LANES], z[KERNEL_LANES]; /* as in neighbours_place */
    float size[KERNEL_LANES];
    float room[KERNEL_LANES]; /* how far each may go, world */
    kernel_vec3 position, normal;
} kernel_particles;

/* Distances are in units of places. */
typedef struct kernel_forces {
    float energy[KERNEL_LANES];                           /* E_i over size^2, full sum */
    float axis1[3][KERNEL_LANES], axis2[3][KERNEL_LANES]; /* the frames */
    float d1[KERNEL_LANES], d2[KERNEL_LANES];             /* the energy's slopes along the two axes */
    float h11[KERNEL_LANES], h12[KERNEL_LANES], h22[KERNEL_LANES]; /* first term of (10) in the frame */
    float nearest2[KERNEL_LANES]; /* squared distance of the nearest within the support; inf: none */
} kernel_forces;

typedef struct kernel_params {
    double unit;     /* of places, world */
    double support;  /* of a pair of particles of size 1, world */
    double omega;    /* over-relaxation */
    double longest;  /* step, over size, beyond which a particle does not glide */
    double farthest; /* from the surface, over size, whence one Newton step is enough */
} kernel_params;

/* Where the particles are on their way: after the step in the tangent plane, then on the surface. */
typedef struct kernel_way {
    kernel_vec3 to;
    kernel_vec3 gradient; /* of the field at `to`, and its value: for `land` to read; the normal after it */
    double value[KERNEL_LANES];
    double limit2[KERNEL_LANES]; /* squared longest displacement */
    double length[KERNEL_LANES]; /* of the displacement, after `land` */
    bool ends_well[KERNEL_LANES];
} kernel_way;

typedef struct kernel {
    void (*forces)(const neighbours_place *place, const kernel_particles *particles,
                   const kernel_params *params, kernel_forces *out);
    /* The step in the tangent plane, shorter than the room and the way to the nearest neighbour. */
    void (*step)(const kernel_particles *particles, const kernel_forces *forces, const kernel_params *params,
                 kernel_way *out);
    /* The Newton step onto the surface. */
    void (*land)(const kernel_particles *particles, const kernel_params *params, kernel_way *way);
} kernel;

const kernel *kernel_for(isa which);

#endif
