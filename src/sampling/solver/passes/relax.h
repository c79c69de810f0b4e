// SPDX-License-Identifier: Apache-2.0
/* relax: relaxation sweeps. One sweep moves every particle once (Gauss-Seidel) by Levenberg-Marquardt
 * (10)-(12) with the two-step motion (8)(9).
 *
 * Departures from the paper:
 * - The Hessian is taken in the tangent frame.
 * - A trial must decrease the particle's energy by at least `gain` times the energy. A particle whose best
 *   step decreases it by less has converged: its lambda is set to the cap. Thus the mean of log10 lambda
 *   measures convergence.
 * - The step is over-relaxed.
 * - Amplitudes and normals are those of the last list build.
 * - Pairs on opposite walls of a thin part do not repel each other.
 *
 * World space. Results do not depend on the number of threads.
 */
#ifndef HEXAD_SAMPLING_SOLVER_PASSES_RELAX_H
#define HEXAD_SAMPLING_SOLVER_PASSES_RELAX_H

#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/field/field.h"
#include "sampling/packing/energy.h"
#include "sampling/packing/fast_kernel.h"
#include "sampling/solver/particles/particles.h"

typedef struct relax relax;

typedef enum relax_minimiser {
    RELAX_LEVENBERG_MARQUARDT,
    RELAX_GRADIENT /* steepest descent (5) by `step`: every step is accepted, lambda is 0 */
} relax_minimiser;

typedef struct relax_params {
    const field *field;
    relax_minimiser minimiser;
    double step;      /* of the gradient minimiser, in units of sigma^2 per energy */
    double sigma;     /* support of the potential for particles of size 1 */
    double spacing;   /* h; tolerances are proportional to h * size */
    double omega;     /* over-relaxation factor of the step; 1: as in the paper */
    double fast_step; /* maximum step of the fast kernel over h * size; it is taken without an energy test */
    double gain;      /* minimum relative decrease of a particle's energy by a trial */
    /* early sweeps of a level: on triangles, a trial is accepted by the energy in the tangent plane alone */
    bool shaken;
    /* with the fast kernel: skip converged particles with converged neighbours (relax_allow_skipping) */
    bool may_skip;
} relax_params;

typedef struct relax_sums {
    /* mean of E_i / size^2 when the particles were visited; E_i: the sum over all neighbours */
    double energy;
    double mean_log10_lambda;
    double rms_step;   /* over h * size */
    double max_step;   /* over h * size */
    uint64_t rejected; /* rejected trials */
    size_t limited;    /* particles whose step is limited by the validity of the lists; build them again */
    /* rms step over h * size of the displaced particles (relax_mark_displaced); 0: there are none */
    double displaced_step;
    size_t displaced_limited; /* displaced particles among `limited` */
} relax_sums;

#define RELAX_LAMBDA_CAP \
    16.0 /* log10 of the damping of a converged particle; the paper stops at a mean of 14 */

/* Scratch memory for `capacity` particles under a potential. `pool` does the work; neither is owned.
 * `list_limit`: maximum size of the lists, bytes. `fast` (or NULL): the kernel for particles without
 * divergent neighbour normals; it requires the cotangent potential. NULL: limit_memory. */
relax *relax_new(size_t capacity, const energy_function *energy, const fast_kernel *fast, size_t list_limit,
                 threads *pool, error *e);
void relax_free(relax *r);

/* Builds the neighbour lists for a support of `sigma` with a Verlet skin `skin`, both times the size. They
 * are valid until a particle has moved skin / 2. Pair weights are those of the current normals, amplitudes
 * and sizes. Error: limit_memory. */
bool relax_build(relax *r, particles *p, double sigma, double skin, error *e);

/* From now on pairs have full weight for any normals: opposite walls repel each other. */
void relax_ignore_normals(relax *r);

/* Updates the positions and sizes in the lists after particles were moved outside a sweep; their number is
 * unchanged. False: the lists do not cover a support of `sigma`, or were never built; build them. Call at
 * most once after a build. Afterwards the lists are valid for energies, not for sweeps. */
bool relax_refresh(relax *r, const particles *p, double sigma);

/* Marks particle i, which is or was relocated, and its neighbours as displaced, in the current lists and in
 * those of the next build. The rms step of all particles would not show the steps of a few. Does nothing
 * before the first build. */
void relax_mark_displaced(relax *r, const particles *p, size_t i);

/* Removes all marks of displaced particles. */
void relax_clear_displaced(relax *r);

/* From now on sweeps may skip converged particles (relax_params.may_skip). Error: limit_memory. */
bool relax_allow_skipping(relax *r, error *e);

/* One sweep over lists that cover params->sigma. Allocates no memory. */
void relax_sweep(relax *r, particles *p, const relax_params *params, relax_sums *out);

/* Mean of E_i over size^2, over the mean amplitude, at the current positions. The lists cover `sigma`.
 * Particles near boundaries, which lack half of their neighbours, are excluded unless there are no others.
 * Sets p->energy. */
double relax_mean_energy(relax *r, particles *p, double sigma);

/* relax_mean_energy without particles that nearly coincide with another: no support makes their energy
 * small. */
double relax_packing_energy(relax *r, particles *p, double sigma);

typedef struct relax_steps {
    double all;
    /* without particles that have converged on a kink, such as an edge between facets */
    double without_kinks;
} relax_steps;

/* The rms of the Newton steps (12) of the particles at their positions, over spacing and size. Measures the
 * distance to convergence. Included are particles away from boundaries and edges (no normal within the
 * support diverges by more than 37 degrees), where the energy is smooth. NaN: there are none; with patches:
 * they are fewer than a fifth. `watch`: from now on, particles with a long step only take steps that decrease
 * their energy (guarded steps, see relax_internal.h). If all are evaluated by the kernel, p->energy is set
 * as well. The result is cached until a particle moves by 5e-5 of its support or changes its size. */
relax_steps relax_rms_steps_left(relax *r, particles *p, double sigma, double spacing, bool watch);

/* The largest support that the lists cover until a particle moves. */
double relax_max_support(const relax *r);

/* Changes the support of the lists to `sigma`, which they cover; the difference becomes the skin. No particle
 * has moved since the build. */
void relax_set_support(relax *r, double sigma);

/* Fraction of particles with divergent neighbour normals from which the spacing hardly resolves the
 * surface. */
#define RELAX_MOSTLY_DIVERGENT 0.5

/* Fraction of the particles with divergent neighbour normals (60 degrees or more) at the last list build: at
 * an edge, or with a neighbour on the opposite wall. */
double relax_divergent_share(const relax *r, const particles *p);

/* Whether there are many particles and a large fraction of them has divergent neighbour normals
 * (relax_lists.c has the limits). Then guarded steps are taken in SIMD lanes. Always false on patches and
 * without the fast kernel. */
bool relax_has_divergent_normals(const relax *r);

/* Whether in addition at least RELAX_MOSTLY_DIVERGENT of the particles have divergent neighbour normals. */
bool relax_has_mostly_divergent_normals(const relax *r);

/* Defect fraction: the fraction of the particles away from boundaries without six neighbours between the
 * first and the second shell of the packing of `spacing`. The lists cover that distance. `smooth`: only
 * particles without divergent neighbour normals, if there are any. From 200 000 particles on the result is
 * an estimate from a subset. */
double relax_defect_fraction(const relax *r, const particles *p, double spacing, bool smooth);

/* Mean number of neighbours within `sigma` times the mean size of the pair (m of Table 1). */
double relax_mean_neighbours(const relax *r, const particles *p, double sigma);

#endif
