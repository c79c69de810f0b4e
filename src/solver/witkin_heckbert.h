/* witkin_heckbert: the method that the paper compares itself with (section 3), for comparison.
 *
 * Particles repel each other by Gaussians whose radius sigma_i each of them adapts to its own energy; one
 * whose radius is above the target splits, one whose radius is well below it may die. How many there are at
 * the end is the system's affair. Source: Witkin and Heckbert 1994, "Using Particles to Sample and Control
 * Implicit Surfaces", section 4, of which the parameters and their defaults are; without the moving surface.
 * Where amplitudes are given the target radius of each particle is in proportion to its own, as the
 * extensions for curvature do that section 3 discusses.
 *
 * Departures: beta is in units of 1 / sigma_i instead of 1 / length, so that surfaces of any size behave
 * alike; Gaussians are cut off at four deviations; a step is no longer than the particle's radius, and one
 * that ends off the surface is projected.
 *
 * These are the formulas; witkin_heckbert_solver.c runs the particles. Pure functions, any thread.
 */
#ifndef HEXAD_SOLVER_WITKIN_HECKBERT_H
#define HEXAD_SOLVER_WITKIN_HECKBERT_H

#include <stddef.h>
#include <stdint.h>

#include "geometry/vec3.h"

typedef struct witkin_heckbert_params {
    double alpha;     /* amplitude of the Gaussians: E_ij = alpha exp(-r^2 / (2 sigma_i^2)) */
    double e_hat;     /* desired energy of a particle, over alpha */
    double rho;       /* feedback of the energy: dD/dt = -rho (D - E_hat) */
    double phi;       /* feedback of the constraint: dF/dt = -phi F */
    double beta;      /* keeps sigma' finite where a particle has no neighbours; over 1 / sigma_i */
    double dt;        /* time step of Euler's method */
    double gamma;     /* near equilibrium: |p'| < gamma sigma_i */
    double nu;        /* a particle may split when its energy is above nu E_hat */
    double delta;     /* it may die when sigma_i < delta sigma_hat */
    double sigma_max; /* it splits above this in any case, world units; 0: half of the surface's size */
} witkin_heckbert_params;

/* What particle i feels. */
typedef struct witkin_heckbert_terms {
    double energy; /* D_i, the sum of E_ij */
    vec3 push;     /* P_i = -sigma_i^2 dE/dp_i, with E_i = sum of E_ij + E_ji */
    double growth; /* sigma_i dD_i / d sigma_i */
    size_t near;   /* particles within its Gaussian */
} witkin_heckbert_terms;

void witkin_heckbert_sum(const witkin_heckbert_params *params, const vec3 *x, const double *sigma, size_t i,
                         const uint32_t *list, size_t count, witkin_heckbert_terms *out);

/* sigma_i': what makes D_i follow its feedback, given how everyone moves. */
double witkin_heckbert_radius_rate(const witkin_heckbert_params *params, const vec3 *x, const vec3 *velocity,
                                   const double *sigma, size_t i, const uint32_t *list, size_t count,
                                   const witkin_heckbert_terms *terms);

/* Distance of neighbours over sigma in a hexagonal packing whose particles have the desired energy. */
double witkin_heckbert_packing(const witkin_heckbert_params *params);

/* Gaussians end at this many deviations. */
#define WITKIN_HECKBERT_REACH 4.0

#endif
