// SPDX-License-Identifier: Apache-2.0
/* witkin_heckbert: formulas of the method with which the paper compares itself (section 3).
 * witkin_heckbert_solver.c uses them.
 *
 * Particles repel each other by Gaussians. Each particle adapts its radius sigma_i to its energy. A particle
 * with a radius above the target splits; a particle with a radius well below the target may die. The final
 * count follows from the parameters. With amplitudes, the target radius of a particle is proportional to its
 * amplitude, as in the extensions by curvature of section 3.
 *
 * Source: Witkin and Heckbert 1994, "Using Particles to Sample and Control Implicit Surfaces", section 4,
 * with its parameters and defaults; without the moving surface.
 *
 * Departures:
 * - beta is in units of 1 / sigma_i instead of 1 / length: the method does not depend on the size of the
 *   surface.
 * - Gaussians are cut off at four standard deviations.
 * - A step is at most the particle's radius; a step that ends off the surface is projected.
 *
 * World space. Pure functions, any thread.
 */
#ifndef HEXAD_SAMPLING_SOLVER_WITKIN_HECKBERT_H
#define HEXAD_SAMPLING_SOLVER_WITKIN_HECKBERT_H

#include <stddef.h>
#include <stdint.h>

#include "geometry/space/vec3.h"

typedef struct witkin_heckbert_params {
    double alpha; /* amplitude of the Gaussians: E_ij = alpha exp(-r^2 / (2 sigma_i^2)) */
    double e_hat; /* desired energy of a particle, over alpha */
    double rho;   /* feedback of the energy: dD/dt = -rho (D - E_hat) */
    double phi;   /* feedback of the constraint: dF/dt = -phi F */
    double beta;  /* keeps sigma' finite for a particle without neighbours; over 1 / sigma_i */
    double dt;    /* time step of Euler's method */
    double gamma; /* near equilibrium: |p'| < gamma sigma_i */
    double nu;    /* a particle may split when its energy is above nu E_hat */
    double delta; /* it may die when sigma_i < delta sigma_hat */
    /* Above this radius a particle always splits, world units. 0: half of the longest side of the surface's
     * bounding box, or 1.5 target radii if that is larger. */
    double sigma_max;
} witkin_heckbert_params;

/* Sums over the neighbours of particle i. */
typedef struct witkin_heckbert_terms {
    double energy; /* D_i, the sum of E_ij */
    vec3 push;     /* P_i = -sigma_i^2 dE/dp_i, with E_i = sum of E_ij + E_ji */
    double growth; /* sigma_i dD_i / d sigma_i */
    size_t near;   /* particles within its Gaussian */
} witkin_heckbert_terms;

/* `list`: the neighbours of particle i within WITKIN_HECKBERT_REACH times the largest radius. */
void witkin_heckbert_sum(const witkin_heckbert_params *params, const vec3 *x, const double *sigma, size_t i,
                         const uint32_t *list, size_t count, witkin_heckbert_terms *out);

/* sigma_i': the rate for which D_i follows its feedback under the velocities of all particles. */
double witkin_heckbert_radius_rate(const witkin_heckbert_params *params, const vec3 *x, const vec3 *velocity,
                                   const double *sigma, size_t i, const uint32_t *list, size_t count,
                                   const witkin_heckbert_terms *terms);

/* Distance of neighbours over sigma in a hexagonal packing whose particles have the desired energy. */
double witkin_heckbert_packing(const witkin_heckbert_params *params);

/* Cut-off of the Gaussians in standard deviations: the value there is 3e-4 of the maximum. */
#define WITKIN_HECKBERT_REACH 4.0

#endif
