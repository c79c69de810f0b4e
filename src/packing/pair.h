/* pair: the sums over a particle's neighbours, which is where the solver's time goes.
 *
 * The energy of a pair of size s is weight s^2 phi(r / (s sigma)): with the size the mean of the ends'
 * requested spacings, the local spacing follows the request (exponent 1; without the factor s^2 it is 0.67).
 *
 * The potential (6), its slope (7) and the first term of its Hessian (10), in the tangent frame of the
 * particle: the Hessian in three dimensions leaks the normal part of the force into the step. Sums run over
 * PAIR_LANES partial sums that are added in a fixed order, so that every vector width gives the same bits.
 * Pure functions of their
 * arguments. */
#ifndef HEXAD_PACKING_PAIR_H
#define HEXAD_PACKING_PAIR_H

#include <math.h>
#include <stddef.h>

#include "geometry/vec3.h"
#include "packing/energy.h"

#define PAIR_LANES 8

/* Neighbours, gathered. `blocks` groups of PAIR_LANES; padding entries have weight 0 and lie at any
 * place but the particle's. Aligned to 64 bytes. */
typedef struct pair_list {
    size_t blocks;
    double *x, *y, *z; /* positions, world space */
    double *weight;    /* what the pair's energy is multiplied by, beside size2 */
    double *size2; /* squared size of the pair over the particle's own; its support is sigma times the size */
    double *nx, *ny, *nz; /* unit normals; only pair_weigh reads them and the next */
    double *amplitude;    /* of (13), (alpha_i + alpha_j) / 2 */
} pair_list;

/* Pairs count in full while their normals differ by less than 120 degrees, and not at all from 143 degrees on
 * (the other side of a thin sheet), with a smooth step between. A sharp edge, where a spline's normals swing
 * to 112 degrees from each other, is well within: were its sides hidden from each other, each would put a row
 * along it. */
#define PAIR_FACING_NONE -0.8
#define PAIR_FACING_RANGE 0.3

/* The same in a straight line, for sums other than the energy of the solve: 0 where the unit normals face away, 1 where they count in full. */
static inline double pair_facing(vec3 a, vec3 b)
{
    return fmin(fmax((vec3_dot(a, b) - PAIR_FACING_NONE) / (-0.5 - PAIR_FACING_NONE), 0), 1);
}

/* Sets the weights that the neighbours have for a particle with normal n. They belong to the energy, so a
 * trial is judged with those of the place where it ends: were they lagged, particles at creases that h does
 * not resolve would trade them for ever. */
void pair_weigh(pair_list *list, vec3 n);

typedef struct pair_forces {
    double energy;        /* E_i, the full sum (no 1/2) */
    double d1, d2;        /* dE_i/dx along the frame's two axes */
    double h11, h12, h22; /* first term of (10) in the frame */
    double nearest2;      /* squared distance of the nearest neighbour of weight > 0; inf: none */
} pair_forces;

/* The cotangent has a vectorised kernel; the other potentials go through their tables. */
void pair_forces_at(const pair_list *list, const energy_function *energy, vec3 x, vec3 axis1, vec3 axis2,
                    double sigma, pair_forces *out);
double pair_energy_at(const pair_list *list, const energy_function *energy, vec3 x, double sigma);

#endif
