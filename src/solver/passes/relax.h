/* relax: sweeps. One sweep moves every particle once, Gauss-Seidel, by Levenberg-Marquardt (10)-(12)
 * with the two-step motion (8)(9), each on the newest positions of its neighbours.
 *
 * Where the paper's text leads astray this follows measured facts: the Hessian is taken in the tangent
 * frame; a trial must gain at least `gain` of the particle's energy, and a particle whose best step
 * would gain less is settled (lambda at its cap), so that the mean of log10 lambda tells when the
 * system is at rest; the step is over-relaxed; repulsion amplitudes and normals are lagged, and pairs
 * on opposite sides of a thin sheet do not push each other.
 */
#ifndef HEXAD_SOLVER_RELAX_H
#define HEXAD_SOLVER_RELAX_H

#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "field/field.h"
#include "packing/energy.h"
#include "packing/fast_kernel.h"
#include "solver/particles/particles.h"

typedef struct relax relax;

typedef enum relax_minimiser {
    RELAX_LEVENBERG_MARQUARDT,
    RELAX_GRADIENT /* steepest descent (5) by `step`: every step is taken, lambda stays 0 */
} relax_minimiser;

typedef struct relax_params {
    const field *field;
    relax_minimiser minimiser;
    double step;    /* of the gradient minimiser, in units of sigma^2 per energy */
    double sigma;   /* support of the potential, of particles of size 1 */
    double spacing; /* h, times size the scale of tolerances */
    double omega;   /* over-relaxation of the step: 1 is the paper's */
    double
        fast_step; /* longest step of the fast kernel, over h size: it is taken without a trial of the energy */
    double gain;   /* least relative decrease of a particle's energy that counts */
    bool
        shaken; /* the level still finds its order: on triangles a trial is accepted by the energy in the tangent plane alone */
    bool
        may_skip; /* with the fast kernel: particles that hardly moved, and those around them neither, are left out: see relax_allow_skipping */
} relax_params;

typedef struct relax_sums {
    double energy; /* mean E_i over size^2, full sums, as the particles were visited */
    double mean_log10_lambda;
    double rms_step;   /* over h size */
    double max_step;   /* likewise */
    uint64_t rejected; /* trials refused */
    size_t limited;    /* particles whose step the lists' validity cut short: build anew */
    /* Of the stirred (relax_mark_displaced): their rms step over h size, 0 where there are none; and how many of them are limited. */
    double displaced_step;
    size_t displaced_limited;
} relax_sums;

#define RELAX_LAMBDA_CAP 16.0 /* log10; the paper stops at a mean of 14 */

/* Scratch for `capacity` particles under a potential, worked on by `pool` (neither owned); lists may take
 * `list_limit` bytes. `fast`: NULL, or, with the cotangent and amplitudes of 1, the kernel for particles whose
 * neighbours all face their way. Error: limit_memory. */
relax *relax_new(size_t capacity, const energy_function *energy, const fast_kernel *fast, size_t list_limit,
                 threads *pool, error *e);
void relax_free(relax *r);

/* Builds the lists for a support of `sigma` that may be used until a particle has moved skin / 2, both times
 * its size, with the pair weights of the present normals, alphas and sizes. Error: limit_memory. */
bool relax_build(relax *r, particles *p, double sigma, double skin, error *e);

/* From now on pairs count in full whatever their normals: sheets push each other through space. */
void relax_ignore_normals(relax *r);

/* Takes note of where particles have been put since the build, and of their sizes; they are as many. False
 * where the lists do not cover a support of `sigma` there, or were never built: they are to be built anew. Once after a
 * build, and no sweeps after it: energies are all that the lists serve for then. */
bool relax_refresh(relax *r, const particles *p, double sigma);

/* Particle i is put elsewhere, or was: it is stirred, and so is who is near it, in the lists that there are and in those that are
 * built next. In the rms step of many the steps of such few do not show. Nothing before there were lists. */
void relax_mark_displaced(relax *r, const particles *p, size_t i);

/* None is stirred any more. */
void relax_clear_displaced(relax *r);

/* From now on sweeps may leave out particles that hardly moved. Error: limit_memory. */
bool relax_allow_skipping(relax *r, error *e);

/* One sweep over lists built for at least params->sigma. Allocates nothing. */
void relax_sweep(relax *r, particles *p, const relax_params *params, relax_sums *out);

/* Mean of E_i over size^2, over the mean of alpha, everyone where they are, for any support that the lists
 * cover; boundaries left out, where half of the neighbours are missing, unless there is nothing else. Sets
 * p->energy. */
double relax_mean_energy(relax *r, particles *p, double sigma);

/* The same without those that lie with another all but in one place: no support makes their energy less, so that they say nothing
 * of which is right. */
double relax_packing_energy(relax *r, particles *p, double sigma);

typedef struct relax_steps {
    double all;
    double
        to_rest; /* without particles that have looked for a better place in vain, as on a kink between facets */
} relax_steps;

/* The rms of the Newton steps (12) that are left to the particles where they are, over `spacing` and the size; no particle moves. Of
 * particles away from boundaries and from edges (within their support no normal is turned by more than 37 degrees): there the
 * energy is smooth, and such a step says how far it is to rest. NaN when there are none, and on patches when they are fewer than a
 * fifth of all. `watch`: a particle with a long step looks at the energy from now on. Where the kernel tells both, energies are
 * known with them, and neither is looked at again until a particle has moved by 5e-5 of its support or has another size. */
relax_steps relax_rms_steps_left(relax *r, particles *p, double sigma, double spacing, bool watch);

/* The largest support that the lists cover, until a particle moves. */
double relax_max_support(const relax *r);

/* From now on the lists, since when nobody has moved, are those of this support, which they cover: what they reach beyond it
 * is their skin. */
void relax_take_support(relax *r, double sigma);

/* Share of the particles that see a neighbour turned from them by 60 degrees or more, when the lists were
 * built: round an edge, or through a sheet. */
double relax_divergent_share(const relax *r, const particles *p);

/* The same of neighbours within `reach` times the mean of both sizes, no farther than the lists. Of particles at random places this share
 * is nearly that of particles at rest. */
double relax_divergent_share_within(const relax *r, const particles *p, double reach);

/* Whether there are many particles, of which so large a share sees others turned away that creased steps are done in lanes. */
bool relax_has_divergent_normals(const relax *r);

/* Whether that share is half or more besides. */
bool relax_has_mostly_divergent_normals(const relax *r);

/* Share of the particles, boundaries left out, that have other than six neighbours between the first and the second shell
 * of the packing of `spacing`, times their sizes. The lists cover that. `smooth`: of those alone that see none turned from them,
 * where there are any. Of 200 000 particles and more it is an estimate: every second is asked, or fewer. */
double relax_defect_fraction(const relax *r, const particles *p, double spacing, bool smooth);

/* Mean number of neighbours within `sigma` times the pair's size (m of Table 1). */
double relax_mean_neighbours(const relax *r, const particles *p, double sigma);

#endif
