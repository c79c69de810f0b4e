// SPDX-License-Identifier: Apache-2.0
/* energy: pair potentials phi(u) of the distance u = r / sigma, as constant tables.
 *
 * phi vanishes at and beyond u = 1. Derivatives are with respect to u; in world units divide the
 * first by sigma, the second by sigma^2. Source: section 4, (6) and (7).
 */
#ifndef HEXAD_SAMPLING_PACKING_ENERGY_H
#define HEXAD_SAMPLING_PACKING_ENERGY_H

#include <stddef.h>

typedef struct energy_function {
    const char *name;
    double (*value)(double u);  /* u > 0 */
    double (*first)(double u);  /* d phi / d u */
    double (*second)(double u); /* d2 phi / d u2 */
    /* energy of a particle of the ideal hexagonal packing: the full sum over the six neighbours at u = 1 /
     * sqrt 3; the next six lie at the support (Figure 3). With the factor 1/2 of (3) it would be half of
     * this. */
    double ideal;
    /* d log E / d log sigma of that packing */
    double ideal_slope;
} energy_function;

/* The default: cot w + w - pi/2 with w = u pi/2. Approximately scale invariant, and compact. */
extern const energy_function energy_cotangent;

/* exp(-(3 u)^2 / 2): the Gaussian of Witkin and Heckbert. The standard deviation is a third of the
 * support, where it is truncated. */
extern const energy_function energy_gaussian;

/* 1 / u, truncated: scale invariant, but its steady states depend on the truncation. */
extern const energy_function energy_electrostatic;

/* The potential of this name; NULL: there is none. */
const energy_function *energy_find(const char *name);

/* w cot w on [0, pi/2] as a polynomial in w^2, coefficients from the constant term up: the Taylor
 * series' first ENERGY_COT_TERMS - 1 terms 1 - w^2/3 - w^4/45 - ... would need twice as many, so this
 * is the least-squares fit on Chebyshev nodes; |error| < 1e-13 on the interval. */
#define ENERGY_COT_TERMS 13
extern const double energy_cot_polynomial[ENERGY_COT_TERMS];

/* The sum of weight[k] phi(u) of energy_cotangent for `count` squared arguments u^2 in (0, 1), by that
 * polynomial, vectorised: the same bits for every instruction set. `count` is a multiple of ENERGY_LANES;
 * what fills it up has weight 0. */
#define ENERGY_LANES 8
double energy_cotangent_sum(const double *u2, const double *weight, size_t count);

#endif
