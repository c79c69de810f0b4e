// SPDX-License-Identifier: Apache-2.0
/* pair: the sums over the neighbours of a particle, in double precision.
 *
 * The energy of a pair of size s is weight s^2 phi(r / (s sigma)): with the size the mean of the ends'
 * requested spacings, the local spacing follows the request (exponent 1; without the factor s^2 it is 0.67).
 *
 * The potential (6), its slope (7) and the first term of its Hessian (10), in the tangent frame of the
 * particle: the Hessian in three dimensions leaks the normal part of the force into the step. Sums run over
 * PAIR_LANES partial sums that are added in a fixed order, so that every vector width gives the same bits.
 * Pure functions of their
 * arguments. */
#ifndef HEXAD_SAMPLING_PACKING_PAIR_H
#define HEXAD_SAMPLING_PACKING_PAIR_H

#include <math.h>
#include <stddef.h>

#include "geometry/space/vec3.h"
#include "sampling/packing/energy.h"

#define PAIR_LANES 8

/* w cot w for vectors of floats, as a polynomial in q = w^2, for w in [0, pi/2]; also the powers q2 = q^2 and q4 = q^4. Least
 * squares at Chebyshev nodes. Error 5e-8, with rounding 2e-7. Estrin's scheme has the shortest chain of dependent
 * operations. */
#define PAIR_W_COT_W(q, q2, q4)                                                                       \
    (((9.99999958e-01f - 3.33331684e-01f * (q)) - (2.22326308e-02f + 2.09201489e-03f * (q)) * (q2)) - \
     ((2.38374932e-04f + 6.85017157e-06f * (q)) + 5.74249429e-06f * (q2)) * (q4))

/* Gathered neighbours of a particle, in `blocks` groups of PAIR_LANES. Padding entries have weight 0 and any
 * position except that of the particle. Arrays are aligned to 64 bytes. */
typedef struct pair_list {
    size_t blocks;
    double *x, *y, *z; /* positions, world space */
    double *weight;    /* factor on the energy of the pair, besides size2 */
    /* squared size of the pair over that of the particle; the support of the pair is sigma times the size */
    double *size2;
    double *nx, *ny, *nz; /* unit normals, used by pair_weigh only */
    double *amplitude;    /* (alpha_i + alpha_j) / 2 of (13), used by pair_weigh only */
} pair_list;

/* The number of arrays of a pair_list. */
enum { PAIR_LIST_ARRAYS = 9 };

/* A list without neighbours whose arrays are in `number`, PAIR_LIST_ARRAYS times `length` doubles.
 * `length`: a multiple of PAIR_LANES. */
static inline pair_list pair_list_in(double *number, size_t length)
{
    pair_list list = {0};
    double **array[PAIR_LIST_ARRAYS] = {&list.x,  &list.y,  &list.z,  &list.weight,   &list.size2,
                                        &list.nx, &list.ny, &list.nz, &list.amplitude};
    for (size_t k = 0; k < PAIR_LIST_ARRAYS; k++) *array[k] = number + k * length;
    return list;
}

/* Sets entry k: position, unit normal, amplitude and size of the pair. The weight is the amplitude until
 * pair_weigh. */
static inline void pair_list_set(pair_list *list, size_t k, vec3 x, vec3 n, double amplitude, double size)
{
    list->x[k] = x.x;
    list->y[k] = x.y;
    list->z[k] = x.z;
    list->nx[k] = n.x;
    list->ny[k] = n.y;
    list->nz[k] = n.z;
    list->amplitude[k] = list->weight[k] = amplitude;
    list->size2[k] = size * size;
}

/* Facing weight of a pair, by the cosine of the normals: 1 above -0.5 (120 degrees), 0 below PAIR_FACING_NONE
 * (143 degrees: opposite walls of a thin part), with a smooth step between. At a sharp edge, where the
 * normals of a spline differ by up to 112 degrees, the weight is 1. Otherwise both sides of the edge would
 * place particles along it. */
#define PAIR_FACING_NONE -0.8
#define PAIR_FACING_RANGE 0.3

/* The same with a linear step, for sums other than the energy of the solve. `a`, `b`: unit normals. */
static inline double pair_facing(vec3 a, vec3 b)
{
    return fmin(fmax((vec3_dot(a, b) - PAIR_FACING_NONE) / (-0.5 - PAIR_FACING_NONE), 0), 1);
}

/* Sets `weight` for a particle with normal n: amplitude times facing weight. The weight is part of the
 * energy, so that a trial uses the normal at its end. With constant weights, particles at creases that h
 * does not resolve would never converge. */
void pair_weigh(pair_list *list, vec3 n);

typedef struct pair_forces {
    double energy;        /* E_i, the full sum (no 1/2) */
    double d1, d2;        /* dE_i/dx along the two axes of the frame */
    double h11, h12, h22; /* first term of (10) in the frame */
    double nearest2;      /* squared distance of the nearest neighbour with weight > 0; infinity: none */
} pair_forces;

/* The sums for a particle at x with the axes of its tangent frame. `sigma`: the support times the size of the
 * particle, world units. The cotangent potential is vectorised; other potentials are evaluated by their
 * function pointers. */
void pair_forces_at(const pair_list *list, const energy_function *energy, vec3 x, vec3 axis1, vec3 axis2,
                    double sigma, pair_forces *out);
double pair_energy_at(const pair_list *list, const energy_function *energy, vec3 x, double sigma);

#endif
