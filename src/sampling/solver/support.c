// SPDX-License-Identifier: Apache-2.0
/* support: search for the support for which the particles have the ideal energy (section 6.1,
 * adaptation.h). */
#include "base/core/elementary.h"
#include "geometry/space/packing.h"
#include "sampling/solver/adaptation.h"

/* Minimum support within one set of lists over the current support. */
static const double SHRINK_LIMIT = 0.2;
/* Verlet skin of the lists over the support: the maximum growth within one set of lists. */
static const double SUPPORT_GROWTH = 0.5;
/* The same over the spacing for the first lists of a search, and for those after it. With 0.3, few particles on a curved
 * surface have no neighbour in these lists: their count is not controlled, and coincident ones stay so. */
static const double SUPPORT_SKIN = 0.6;
/* Relative tolerance of the energy and of the support at its bounds. */
static const double SUPPORT_TOLERANCE = 1e-6;
/* Maximum number of Newton steps with one set of lists. */
enum { SUPPORT_STEPS = 6 };
/* Maximum number of list builds of a search. */
enum { SUPPORT_BUILDS = 24 };

/* Minimum support over the spacing. A smaller support has only pairs of nearly coincident particles. */
static const double MIN_SUPPORT = 0.5;
/* Maximum support over the spacing. A larger support results only if few particles have neighbours on their
 * patch. No support gives them the ideal energy, and a large one does not separate particles. */
static const double MAX_SUPPORT = 3;

double solver_nearer_support(const solver *s, double sigma, double energy)
{
    return sigma *
           elementary_pow(energy / s->setup.params.energy->ideal, -1 / s->setup.params.energy->ideal_slope);
}

/* The support for which the particles at their positions have the ideal energy (6.1: a one-dimensional
 * optimisation), within the range of the lists. */
static double ideal_support(const solver *s)
{
    double low = SHRINK_LIMIT * s->state.sigma, high = relax_max_support(s->scratch.relax),
           sigma = s->state.sigma;
    for (int k = 0; k < SUPPORT_STEPS; k++) {
        double energy = relax_packing_energy(s->scratch.relax, s->state.p, sigma);
        if (!(energy > 0)) return high;
        if (fabs(energy / s->setup.params.energy->ideal - 1) < SUPPORT_TOLERANCE) break;
        sigma = fmin(fmax(solver_nearer_support(s, sigma, energy), low), high);
    }
    return sigma;
}

/* Builds the lists again whenever sigma reaches their range. */
bool solver_find_support(solver *s, error *e)
{
    const double given = s->state.sigma;
    for (int k = 0; k < SUPPORT_BUILDS; k++) {
        double before = s->state.sigma;
        s->state.skin = SUPPORT_SKIN * s->state.spacing;
        if (k > 0 || !relax_has_divergent_normals(s->scratch.relax))
            s->state.skin = fmax(s->state.skin, SUPPORT_GROWTH * s->state.sigma);
        if (!solver_build_lists(s, e)) return false;
        s->state.sigma = fmin(ideal_support(s), MAX_SUPPORT * s->state.spacing);
        if (s->state.sigma < MIN_SUPPORT * s->state.spacing) {
            s->state.sigma = given;
            break;
        }
        bool at_bound = s->state.sigma >= (1 - SUPPORT_TOLERANCE) * relax_max_support(s->scratch.relax) ||
                        s->state.sigma <= (1 + SUPPORT_TOLERANCE) * SHRINK_LIMIT * before;
        if (!at_bound) break;
    }
    return true;
}

/* With divergent neighbour normals lists are long: the lists of the search are kept. */
bool solver_apply_support(solver *s, bool changed, error *e)
{
    const schedule *given = s->state.regime->schedule;
    if (s->setup.params.max_sigma > 0) s->state.sigma = fmin(s->state.sigma, s->setup.params.max_sigma);
    const double skin = relax_max_support(s->scratch.relax) - s->state.sigma;
    s->state.skin = SUPPORT_SKIN * s->state.spacing;
    if (changed || !relax_has_divergent_normals(s->scratch.relax) ||
        skin < given->skin_narrow * s->state.spacing)
        return solver_build_lists(s, e);
    relax_set_support(s->scratch.relax, s->state.sigma);
    return true;
}
